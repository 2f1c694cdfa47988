// SPDX-License-Identifier: MIT
#pragma once

#include <petscmat.h>
#include <vector>

namespace dolfinx_contact
{

/// Nonzeros of the owned rows: columns owned by this rank, and columns of other ranks.
struct RowCounts
{
  std::vector<PetscInt> diagonal, off_diagonal;
};

/// Count the entries recorded in an assembled matrix of type MATPREALLOCATOR. Collective.
/// @throws std::runtime_error on an error of PETSc
RowCounts count_rows(Mat preallocator);

/// Largest absolute value in each owned row of an assembled matrix. Collective.
/// @throws std::runtime_error on an error of PETSc
std::vector<double> largest_in_rows(Mat A);

} // namespace dolfinx_contact
