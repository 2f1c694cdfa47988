// SPDX-License-Identifier: MIT
#pragma once

#include <petscmat.h>

namespace dolfinx_contact
{

/// The rows of this rank of an AIJ matrix as PETSc stores them, to write to. Each has two parts:
/// the columns of this rank, and those of others.
class MatrixRows
{
public:
  /// Take the arrays of A. Between `open` and `close` nothing else may write to it.
  /// @returns false if A has none: it is of another type, or has never been assembled
  /// @throws std::runtime_error on an error of PETSc
  bool open(Mat A);
  void close();

  /// Whether A has the pattern of the matrix that was open before: places hold.
  bool same() const { return _same; }

  /// Rows of this rank.
  PetscInt size() const { return _last - _first; }
  PetscInt first() const { return _first; }
  bool has(PetscInt row) const { return row >= _first and row < _last; }

  /// Part of a column: 0 if it is of this rank.
  int part(PetscInt column) const { return column < _first_column or column >= _last_column; }

  /// Where consecutive columns of one part are, from the beginning of this part of a row.
  /// @param row counted from this rank's first
  /// @returns −1 if the row has no places for them
  PetscInt place(PetscInt row, PetscInt column, PetscInt length) const;

  /// Beginning of a row in a part, null if there is no such part.
  PetscScalar* values(int part, PetscInt row) const
  {
    const Part& p = _parts[part];
    return p.A ? p.values + p.offset[row] : nullptr;
  }

private:
  struct Part
  {
    Mat A = nullptr;
    PetscInt rows = 0;
    const PetscInt *offset = nullptr, *columns = nullptr;
    PetscScalar* values = nullptr;
    void open(Mat part);
    void close();
  };

  bool _same = false;
  PetscObjectId _id = 0;           // of the last matrix
  PetscObjectState _nonzeros = -1; // its pattern
  PetscInt _first = 0, _last = 0, _first_column = 0, _last_column = 0;
  const PetscInt* _others = nullptr; // columns of other ranks, ascending
  PetscInt _num_others = 0;
  Part _parts[2];
};

} // namespace dolfinx_contact
