// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <petscmat.h>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Adds the blocks of pairs of facets to a matrix. MatSetValues searches every column in every row,
/// at each assembly anew; for AIJ matrices that are assembled, a block's places in the arrays of
/// the rows of this rank are found once and kept as long as the pattern holds. Rows of other ranks,
/// and matrices of other types, go through MatSetValues.
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
  /// @throws std::runtime_error on an error of PETSc
  void open(Mat A);
  void close();

  /// Add values, (rows, columns). Negative rows and columns are dropped.
  /// @throws std::runtime_error if the pattern has no place for an entry
  void add(const Name& name, std::span<const PetscInt> rows, std::span<const PetscInt> columns,
           const double* values);

  /// As `add`, without keeping the places.
  void add_once(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
                const double* values) const;

private:
  // The rows of this rank are [first, last); columns in `own` order if this rank owns them
  struct Part
  {
    Mat A = nullptr;
    PetscInt rows = 0;
    const PetscInt *offset = nullptr, *columns = nullptr;
    PetscScalar* values = nullptr;
    void open(Mat part);
    void close();
  };
  struct Entry
  {
    int target, kind;
    int next;         // of the same facet, or −1
    std::size_t data; // where its description starts in `_data`
  };

  std::size_t describe(std::span<const PetscInt> rows, std::span<const PetscInt> columns);
  void fetch(const PetscInt* group, const PetscInt* run, PetscInt runs, PetscInt groups) const;
  PetscInt place(int part, PetscInt row, PetscInt column, PetscInt length) const;

  Mat _matrix = nullptr;
  bool _direct = false;            // _matrix has arrays to write to
  PetscObjectId _id = 0;           // of the matrix whose places are kept
  PetscObjectState _nonzeros = -1; // its pattern
  PetscInt _first = 0, _last = 0, _first_column = 0, _last_column = 0;
  const PetscInt* _others = nullptr; // columns of other ranks, ascending
  PetscInt _num_others = 0;
  Part _parts[2]; // of the matrix: columns of this rank, of others

  std::vector<int> _head; // of each facet: its first entry, or −1
  std::vector<Entry> _entries;
  std::vector<PetscInt> _data;
  std::vector<PetscInt> _remote; // work space
};

} // namespace dolfinx_contact
