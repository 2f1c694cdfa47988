// SPDX-License-Identifier: MIT
#pragma once

#include "remote_rows.h"

#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Adds the blocks of pairs of facets to a matrix. MatSetValues searches every column in every row,
/// at each assembly anew; for AIJ matrices that are assembled, a block's places in the arrays of
/// the rows are found once and kept as long as the pattern holds: those of this rank's rows in the
/// matrix, those of others' in a RemoteRows. Matrices of other types go through MatSetValues, and
/// so do rows of other ranks if there is no RemoteRows.
///
/// Consecutive columns are a run: a row that has them all has them side by side. Rows whose runs
/// begin at the same distances from the rows' beginnings (those of one node, in general) share
/// them.
class BlockAdder
{
public:
  /// Name of a block: two blocks of one name have the same rows and columns.
  struct Name
  {
    int facet, target, kind;
  };

  /// Forget all places: rows or columns have been renumbered, or the pattern is a new one.
  void forget();

  /// The next blocks are for A. Between `open` and `close` nothing else may write to A.
  /// @param remote takes what is for other ranks, and sends it after; null: MatSetValues does
  /// @throws std::runtime_error on an error of PETSc
  void open(Mat A, RemoteRows* remote = nullptr);
  void close();

  /// Add values, (rows, columns). Negative rows and columns are dropped.
  /// @throws std::runtime_error if the pattern has no place for an entry
  void add(const Name& name, std::span<const PetscInt> rows, std::span<const PetscInt> columns,
           const double* values);

  /// As `add`, without keeping the places.
  void add_once(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
                const double* values) const;

private:
  struct Entry
  {
    int target, kind;
    int next;         // of the same facet, or −1
    std::size_t data; // where its description starts in `_data`
  };

  std::size_t describe(std::span<const PetscInt> rows, std::span<const PetscInt> columns);
  void fetch(const PetscInt* group, const PetscInt* run, PetscInt runs, PetscInt groups) const;
  PetscInt place(PetscInt row, PetscInt column, PetscInt length) const;
  PetscScalar* begin(int part, PetscInt row) const;

  Mat _matrix = nullptr;
  bool _direct = false; // _matrix has arrays to write to
  MatrixRows _own;
  RemoteRows* _remote = nullptr; // its rows are numbered after the own ones

  std::vector<int> _head; // of each facet: its first entry, or −1
  std::vector<Entry> _entries;
  std::vector<PetscInt> _data;
  std::vector<PetscInt> _stashed; // work space
};

} // namespace dolfinx_contact
