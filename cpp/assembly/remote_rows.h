// SPDX-License-Identifier: MIT
#pragma once

#include "matrix_rows.h"

#include <cstddef>
#include <mpi.h>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Rows of other ranks that this rank adds to: a small matrix of its own, which is summed here,
/// then sent to the owners, one message for each, and added there at places that are found once.
///
/// PETSc's own way keeps each block until the assembly, sorts all their rows, and looks for each
/// column: a partition that parts slave from master takes several times longer by it than one rank.
class RemoteRows
{
public:
  RemoteRows() = default;

  /// @param starts first row of each rank, and the end
  /// @param rows global, ascending; of other ranks
  /// @param offset of each row in `columns`, (rows + 1)
  /// @param columns global, ascending in each row
  RemoteRows(MPI_Comm comm, std::vector<PetscInt> starts, std::vector<PetscInt> rows,
             std::vector<std::size_t> offset, std::vector<PetscInt> columns);

  /// Nothing is added yet.
  void zero();

  /// Number of a global row, −1 if it is not here.
  PetscInt find(PetscInt row) const;

  /// Where consecutive columns are, from the beginning of a row; −1 if there are no such places.
  PetscInt place(PetscInt row, PetscInt column, PetscInt length) const;

  /// Beginning of a row.
  PetscScalar* values(PetscInt row) { return _values.data() + _offset[row]; }

  PetscInt size() const { return static_cast<PetscInt>(_rows.size()); }

  /// Add all to the rows of A, on their ranks. Collective; A is assembled, and has this pattern.
  /// @throws std::invalid_argument on all ranks, if A has no place for an entry, or is no AIJ
  /// matrix
  void send(Mat A);

private:
  // Consecutive entries of what a rank sends, and where they go
  struct Target
  {
    PetscInt row, place, length;
    int part;
  };
  // Of values, for each rank
  struct Counts
  {
    std::vector<int> size, offset;
  };
  void find_targets();

  MPI_Comm _comm = MPI_COMM_NULL;
  std::vector<PetscInt> _starts;
  std::vector<PetscInt> _rows, _columns;
  std::vector<std::size_t> _offset;
  std::vector<PetscScalar> _values;

  MatrixRows _own; // where what comes from others goes
  std::vector<Target> _targets;
  Counts _sent, _received;
  std::vector<PetscScalar> _inbox;
};

} // namespace dolfinx_contact
