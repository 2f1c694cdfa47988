// SPDX-License-Identifier: MIT
#include "block_adder.h"

#include "events.h"
#include "petsc_check.h"

#include <algorithm>
#include <utility>

namespace dolfinx_contact
{

void BlockAdder::Part::open(Mat part)
{
  PetscBool done = PETSC_FALSE;
  check(MatGetRowIJ(part, 0, PETSC_FALSE, PETSC_FALSE, &rows, &offset, &columns, &done),
        "MatGetRowIJ");
  if (not done)
    throw std::runtime_error("MatGetRowIJ: an AIJ matrix without rows");
  A = part;
  check(MatSeqAIJGetArray(A, &values), "MatSeqAIJGetArray");
}

void BlockAdder::Part::close()
{
  if (values)
    check(MatSeqAIJRestoreArray(A, &values), "MatSeqAIJRestoreArray");
  PetscBool done = PETSC_FALSE;
  if (A)
    check(MatRestoreRowIJ(A, 0, PETSC_FALSE, PETSC_FALSE, &rows, &offset, &columns, &done),
          "MatRestoreRowIJ");
  *this = {};
}

void BlockAdder::forget()
{
  _head.clear();
  _entries.clear();
  _data.clear();
}

void BlockAdder::open(Mat A)
{
  _matrix = A;
  PetscBool seq = PETSC_FALSE, mpi = PETSC_FALSE, assembled = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(A), MATSEQAIJ, &seq), "open");
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(A), MATMPIAIJ, &mpi), "open");
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
  const bool known = id == _id and nonzeros == _nonzeros;
  _direct = (seq or mpi) and (assembled or known);
  if (not _direct)
    return;
  if (not known)
    forget();
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
}

void BlockAdder::close()
{
  if (not _matrix)
    return;
  for (Part& part : _parts)
    part.close();
  _matrix = nullptr;
}

// Position of a run's first column, from the beginning of the row.
PetscInt BlockAdder::place(int part, PetscInt row, PetscInt column, PetscInt length) const
{
  const Part& p = _parts[part];
  PetscInt local = column - _first_column, last = local + length - 1;
  if (part == 1)
  {
    const PetscInt* const end = _others + _num_others;
    local = std::lower_bound(_others, end, column) - _others;
    last = local + length - 1;
    if (last >= _num_others or _others[local] != column or _others[last] != column + length - 1)
      last = local = _num_others; // no row has it
  }
  const PetscInt *const begin = p.columns + p.offset[row], *const end
                                                           = p.columns + p.offset[row + 1];
  const PetscInt* const it = std::lower_bound(begin, end, local);
  if (end - it < length or *it != local or it[length - 1] != last)
    throw std::runtime_error("contact tangent: the matrix has no place for row "
                             + std::to_string(_first + row) + ", columns from "
                             + std::to_string(column) + "; its pattern is not that of the targets");
  return it - begin;
}

// Description of a block: 1 if it has rows of other ranks, number of runs, number of groups of
// rows; for each run its first column in the block, its length and its part; for each group its
// first row in the block, number of rows, first row in the parts, and the place of each run.
std::size_t BlockAdder::describe(std::span<const PetscInt> rows, std::span<const PetscInt> columns)
{
  const std::size_t start = _data.size();
  _data.insert(_data.end(), {0, 0, 0});
  const auto part = [&](PetscInt c) { return c < _first_column or c >= _last_column; };
  const PetscInt nc = columns.size(), nr = rows.size();
  for (PetscInt c = 0, length; c < nc; c += length)
  {
    length = 1;
    if (columns[c] < 0)
      continue;
    while (c + length < nc and columns[c + length] == columns[c] + length
           and part(columns[c + length]) == part(columns[c]))
      ++length;
    _data.insert(_data.end(), {c, length, part(columns[c])});
    ++_data[start + 1];
  }
  const PetscInt runs = _data[start + 1];
  std::size_t last = 0; // the last group
  for (PetscInt r = 0; r < nr; ++r)
  {
    if (rows[r] < 0)
      continue;
    if (rows[r] < _first or rows[r] >= _last)
    {
      _data[start] = 1;
      continue;
    }
    const PetscInt row = rows[r] - _first;
    const std::size_t group = _data.size();
    _data.insert(_data.end(), {r, 1, row});
    for (PetscInt k = 0; k < runs; ++k)
    {
      const PetscInt* run = &_data[start + 3 + 3 * k];
      _data.push_back(place(run[2], row, columns[run[0]], run[1]));
    }
    const bool joins = last > 0 and _data[last] + _data[last + 1] == r
                       and _data[last + 2] + _data[last + 1] == row
                       and std::equal(&_data[last + 3], &_data[last + 3] + runs, &_data[group + 3]);
    if (joins)
    {
      ++_data[last + 1];
      _data.resize(group);
    }
    else
    {
      last = group;
      ++_data[start + 2];
    }
  }
  return start;
}

// Rows of a large matrix come from memory: ask for all of the block at once rather than wait for
// one after the other.
void BlockAdder::fetch(const PetscInt* group, const PetscInt* run, PetscInt runs,
                       PetscInt groups) const
{
  for (PetscInt g = 0; g < groups; ++g, group += 3 + runs)
    for (PetscInt i = 0; i < group[1]; ++i)
      for (PetscInt k = 0; k < runs; ++k)
      {
        const Part& part = _parts[run[3 * k + 2]];
        const PetscScalar* const to = part.values + part.offset[group[2] + i] + group[3 + k];
        for (PetscInt j = 0; j < run[3 * k + 1]; j += 8)
          __builtin_prefetch(to + j, 1);
      }
}

void BlockAdder::add(const Name& name, std::span<const PetscInt> rows,
                     std::span<const PetscInt> columns, const double* values)
{
  const Logged logged(Event::insertion);
  if (not _direct)
    return add_once(rows, columns, values);
  if (name.facet >= static_cast<int>(_head.size()))
    _head.resize(name.facet + 1, -1);
  int e = _head[name.facet];
  while (e >= 0 and (_entries[e].target != name.target or _entries[e].kind != name.kind))
    e = _entries[e].next;
  if (e < 0)
  {
    const std::size_t data = describe(rows, columns); // first: it may throw
    e = static_cast<int>(_entries.size());
    _entries.push_back({name.target, name.kind, std::exchange(_head[name.facet], e), data});
  }

  const PetscInt* d = &_data[_entries[e].data];
  const PetscInt remote = d[0], runs = d[1], groups = d[2];
  const PetscInt* const run = d + 3;
  const std::size_t width = columns.size();
  d = run + 3 * runs;
  fetch(d, run, runs, groups);
  for (PetscInt g = 0; g < groups; ++g, d += 3 + runs)
    for (PetscInt i = 0; i < d[1]; ++i)
    {
      PetscScalar* const begin[2]
          = {_parts[0].values + _parts[0].offset[d[2] + i],
             _parts[1].A ? _parts[1].values + _parts[1].offset[d[2] + i] : nullptr};
      const double* const from = values + (d[0] + i) * width;
      for (PetscInt k = 0; k < runs; ++k)
      {
        const PetscInt* const r = run + 3 * k;
        PetscScalar* const to = begin[r[2]] + d[3 + k];
        for (PetscInt j = 0; j < r[1]; ++j)
          to[j] += from[r[0] + j];
      }
    }
  if (not remote)
    return;
  _remote.assign(rows.begin(), rows.end());
  for (PetscInt& r : _remote)
    if (r >= _first and r < _last)
      r = -1;
  add_once(_remote, columns, values);
}

void BlockAdder::add_once(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
                          const double* values) const
{
  check(MatSetValues(_matrix, rows.size(), rows.data(), columns.size(), columns.data(), values,
                     ADD_VALUES),
        "MatSetValues (contact tangent)");
}

} // namespace dolfinx_contact
