// SPDX-License-Identifier: MIT
#pragma once

#include "remote_rows.h"

#include <cstdint>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Places of a square AIJ matrix, collected before it has any: dense blocks, whose rows may belong
/// to other ranks. The diagonal always has places.
///
/// A row's columns are the union of those of its blocks. Rows of the same blocks, those of one
/// node, share it; it is a list of runs, consecutive columns, far shorter than the row itself. So
/// the collection is small beside the matrix, and nothing is hashed.
class Pattern
{
public:
  /// @param owned number of rows, and columns, of this rank. Collective
  Pattern(MPI_Comm comm, PetscInt owned);

  /// Places of a block. Negative rows and columns are dropped.
  void add(std::span<const PetscInt> rows, std::span<const PetscInt> columns);

  /// Places of a sparse matrix of small dense blocks.
  /// @param first row of the first block; rows follow one another, and are of this rank
  /// @param offset of each row of blocks in `columns`, (rows of blocks + 1)
  /// @param columns first one of each block
  void add_sparse(PetscInt first, PetscInt block_rows, std::span<const std::int64_t> offset,
                  std::span<const PetscInt> columns, PetscInt block_columns);

  /// Bring the rows to their ranks and unite their columns: nothing can be added after. Collective.
  /// @throws std::invalid_argument if the blocks are too many for MPI
  void finish();

  /// Allocate these places, and no others. Collective, after `finish`.
  /// @throws std::runtime_error on an error of PETSc
  void allocate(Mat A) const;

  /// Fill them with zeros and assemble the matrix, that assembly drops none. Collective, after
  /// `allocate`.
  /// @throws std::runtime_error on an error of PETSc
  void fill(Mat A) const;

  /// Rows of other ranks, with the columns of the blocks that were added on this rank. After
  /// `finish`.
  RemoteRows remote_rows() const;

private:
  // Consecutive columns; all of this rank or all of others
  struct Run
  {
    PetscInt first, size;
  };
  // Lists one after another
  template <typename T>
  struct Lists
  {
    std::vector<T> data;
    std::vector<std::size_t> offset{0};
    int size() const { return static_cast<int>(offset.size()) - 1; }
    void close() { offset.push_back(data.size()); }
    std::span<const T> operator[](std::size_t i) const
    {
      return std::span(data).subspan(offset[i], offset[i + 1] - offset[i]);
    }
  };

  bool own(PetscInt dof) const { return dof >= _start and dof < _start + _owned; }
  void add_run(PetscInt first, PetscInt size);
  void send_rows();
  void number_columns();
  PetscInt global(PetscInt column) const
  {
    return column < _owned ? _start + column : _others[column - _owned];
  }

  // Rows from first[g] to first[g + 1] have the columns of columns[g], in ascending order, in local
  // numbers
  struct Rows
  {
    std::vector<PetscInt> first;
    Lists<Run> columns;
  };
  template <typename Number>
  Lists<std::int32_t> blocks_of_rows(int num_blocks, PetscInt num_rows, Number number) const;
  Rows unite(const Lists<std::int32_t>& blocks, bool diagonal) const;

  MPI_Comm _comm;
  PetscInt _owned, _start;
  std::vector<std::int64_t> _starts; // of all ranks, and the end

  // The blocks, until `finish`: global rows; columns are in local numbers from number_columns on
  Lists<PetscInt> _rows;
  Lists<Run> _columns;
  std::vector<PetscInt> _others; // columns of other ranks, ascending; numbered after the own ones

  Rows _united;                  // own rows
  std::vector<PetscInt> _remote; // rows of other ranks that blocks of this one have, ascending
  Rows _united_remote;
};

/// Largest absolute value in each owned row of an assembled matrix. Collective.
/// @throws std::runtime_error on an error of PETSc
std::vector<double> largest_in_rows(Mat A);

} // namespace dolfinx_contact
