// SPDX-License-Identifier: MIT
#include "matrix_rows.h"

#include "petsc_check.h"

#include <algorithm>

namespace dolfinx_contact
{

void MatrixRows::Part::open(Mat part)
{
  PetscBool done = PETSC_FALSE;
  check(MatGetRowIJ(part, 0, PETSC_FALSE, PETSC_FALSE, &rows, &offset, &columns, &done),
        "MatGetRowIJ");
  if (not done)
    throw std::runtime_error("MatGetRowIJ: an AIJ matrix without rows");
  A = part;
  check(MatSeqAIJGetArray(A, &values), "MatSeqAIJGetArray");
}

void MatrixRows::Part::close()
{
  if (values)
    check(MatSeqAIJRestoreArray(A, &values), "MatSeqAIJRestoreArray");
  PetscBool done = PETSC_FALSE;
  if (A)
    check(MatRestoreRowIJ(A, 0, PETSC_FALSE, PETSC_FALSE, &rows, &offset, &columns, &done),
          "MatRestoreRowIJ");
  *this = {};
}

bool MatrixRows::open(Mat A)
{
  PetscBool seq = PETSC_FALSE, mpi = PETSC_FALSE, assembled = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(A), MATSEQAIJ, &seq), "open");
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(A), MATMPIAIJ, &mpi), "open");
  if (not seq and not mpi)
    return false;
  check(MatAssembled(A, &assembled), "MatAssembled");
  Mat own = A, others = nullptr;
  _others = nullptr;
  if (mpi)
    check(MatMPIAIJGetSeqAIJ(A, &own, &others, &_others), "MatMPIAIJGetSeqAIJ");
  // Allocated anew, a matrix on several ranks gets new parts; its own state may be as before then
  // (PETSc 3.22)
  PetscObjectId id = 0;
  PetscObjectState nonzeros = 0;
  if (own)
    check(PetscObjectGetId(reinterpret_cast<PetscObject>(own), &id), "PetscObjectGetId");
  check(MatGetNonzeroState(A, &nonzeros), "MatGetNonzeroState");
  // a matrix that has been assembled with this pattern has no gaps in its arrays, also after others
  // have begun to add to it
  const bool same = id == _id and nonzeros == _nonzeros;
  if (not assembled and not same)
    return false;
  _same = same;
  _id = id;
  _nonzeros = nonzeros;

  check(MatGetOwnershipRange(A, &_first, &_last), "MatGetOwnershipRange");
  check(MatGetOwnershipRangeColumn(A, &_first_column, &_last_column), "MatGetOwnershipRange");
  _num_others = 0;
  if (mpi)
  {
    check(MatGetSize(others, nullptr, &_num_others), "MatGetSize");
    _parts[1].open(others);
  }
  _parts[0].open(own);
  return true;
}

void MatrixRows::close()
{
  for (Part& part : _parts)
    part.close();
}

PetscInt MatrixRows::place(PetscInt row, PetscInt column, PetscInt length) const
{
  const int part = this->part(column);
  const Part& p = _parts[part];
  PetscInt first = column - _first_column, last = first + length - 1;
  if (part == 1)
  {
    const PetscInt* const end = _others + _num_others;
    first = std::lower_bound(_others, end, column) - _others;
    last = first + length - 1;
    if (last >= _num_others or _others[first] != column or _others[last] != column + length - 1)
      return -1;
  }
  if (not p.A)
    return -1;
  const PetscInt *const begin = p.columns + p.offset[row], *const end
                                                           = p.columns + p.offset[row + 1];
  const PetscInt* const it = std::lower_bound(begin, end, first);
  return end - it < length or *it != first or it[length - 1] != last ? -1 : it - begin;
}

} // namespace dolfinx_contact
