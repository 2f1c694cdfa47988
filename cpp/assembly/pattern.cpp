// SPDX-License-Identifier: MIT
#include "pattern.h"

#include "petsc_check.h"

namespace dolfinx_contact
{

RowCounts count_rows(Mat preallocator)
{
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(preallocator), &comm), "count_rows");
  PetscInt rows, columns, first, last;
  check(MatGetLocalSize(preallocator, &rows, &columns), "MatGetLocalSize");

  // an empty matrix with the recorded pattern: as small as the contact part itself
  Mat A;
  check(MatCreate(comm, &A), "MatCreate");
  check(MatSetSizes(A, rows, columns, PETSC_DETERMINE, PETSC_DETERMINE), "MatSetSizes");
  check(MatSetType(A, MATAIJ), "MatSetType");
  check(MatPreallocatorPreallocate(preallocator, PETSC_TRUE, A), "MatPreallocatorPreallocate");
  check(MatGetOwnershipRangeColumn(A, &first, &last), "MatGetOwnershipRangeColumn");

  PetscInt begin, end;
  check(MatGetOwnershipRange(A, &begin, &end), "MatGetOwnershipRange");
  RowCounts out;
  out.diagonal.assign(rows, 0);
  out.off_diagonal.assign(rows, 0);
  for (PetscInt row = begin; row < end; ++row)
  {
    PetscInt n;
    const PetscInt* cols;
    check(MatGetRow(A, row, &n, &cols, nullptr), "MatGetRow");
    for (PetscInt k = 0; k < n; ++k)
      ++(cols[k] >= first and cols[k] < last ? out.diagonal : out.off_diagonal)[row - begin];
    check(MatRestoreRow(A, row, &n, &cols, nullptr), "MatRestoreRow");
  }
  check(MatDestroy(&A), "MatDestroy");
  return out;
}

std::vector<double> largest_in_rows(Mat A)
{
  ::Vec v = nullptr;
  check(MatCreateVecs(A, nullptr, &v), "MatCreateVecs");
  check(MatGetRowMaxAbs(A, v, nullptr), "MatGetRowMaxAbs");
  PetscInt n = 0;
  const PetscScalar* values = nullptr;
  check(VecGetLocalSize(v, &n), "VecGetLocalSize");
  check(VecGetArrayRead(v, &values), "VecGetArrayRead");
  std::vector<double> out(values, values + n);
  check(VecRestoreArrayRead(v, &values), "VecRestoreArrayRead");
  check(VecDestroy(&v), "VecDestroy");
  return out;
}

} // namespace dolfinx_contact
