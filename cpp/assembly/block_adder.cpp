// SPDX-License-Identifier: MIT
#include "block_adder.h"

#include "events.h"
#include "petsc_check.h"

#include <algorithm>
#include <utility>

namespace dolfinx_contact
{

void BlockAdder::forget()
{
  _head.clear();
  _entries.clear();
  _data.clear();
}

void BlockAdder::open(Mat A, RemoteRows* remote)
{
  _matrix = A;
  _direct = _own.open(A);
  if (_direct and (not _own.same() or remote != _remote))
    forget();
  _remote = remote;
}

void BlockAdder::close()
{
  _own.close();
  _matrix = nullptr;
}

// Position of a run's first column from the beginning of a row, or −1.
PetscInt BlockAdder::place(PetscInt row, PetscInt column, PetscInt length) const
{
  const PetscInt remote = row - _own.size();
  return remote < 0 ? _own.place(row, column, length) : _remote->place(remote, column, length);
}

PetscScalar* BlockAdder::begin(int part, PetscInt row) const
{
  return row < _own.size() ? _own.values(part, row) : _remote->values(row - _own.size());
}

// Description of a block: 1 if it has rows for MatSetValues, number of runs, number of groups of
// rows; for each run its first column in the block, its length and its part; for each group its
// first row in the block, number of rows, the first one's number, and the place of each run.
std::size_t BlockAdder::describe(std::span<const PetscInt> rows, std::span<const PetscInt> columns)
{
  const std::size_t start = _data.size();
  _data.insert(_data.end(), {0, 0, 0});
  const PetscInt nc = columns.size(), nr = rows.size();
  for (PetscInt c = 0, length; c < nc; c += length)
  {
    length = 1;
    if (columns[c] < 0)
      continue;
    while (c + length < nc and columns[c + length] == columns[c] + length
           and _own.part(columns[c + length]) == _own.part(columns[c]))
      ++length;
    _data.insert(_data.end(), {c, length, _own.part(columns[c])});
    ++_data[start + 1];
  }
  const PetscInt runs = _data[start + 1];
  std::size_t last = 0; // the last group
  for (PetscInt r = 0; r < nr; ++r)
  {
    if (rows[r] < 0)
      continue;
    const bool remote = not _own.has(rows[r]);
    if (remote and not _remote)
    {
      _data[start] = 1;
      continue;
    }
    const PetscInt row = remote ? _own.size() + _remote->find(rows[r]) : rows[r] - _own.first();
    const std::size_t group = _data.size();
    _data.insert(_data.end(), {r, 1, row});
    for (PetscInt k = 0; k < runs; ++k)
    {
      const PetscInt* run = &_data[start + 3 + 3 * k];
      const bool there = not remote or row >= _own.size();
      _data.push_back(there ? place(row, columns[run[0]], run[1]) : -1);
      if (_data.back() < 0)
        throw std::runtime_error("contact tangent: the matrix has no place for row "
                                 + std::to_string(rows[r]) + ", columns from "
                                 + std::to_string(columns[run[0]])
                                 + "; its pattern is not that of the targets");
    }
    const bool joins = last > 0 and _data[last] + _data[last + 1] == r
                       and _data[last + 2] + _data[last + 1] == row
                       and _own.has(rows[r - 1]) != remote
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
    {
      const PetscScalar* const row[2] = {begin(0, group[2] + i), begin(1, group[2] + i)};
      for (PetscInt k = 0; k < runs; ++k)
      {
        const PetscScalar* const to = row[run[3 * k + 2]] + group[3 + k];
        for (PetscInt j = 0; j < run[3 * k + 1]; j += 8)
          __builtin_prefetch(to + j, 1);
      }
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
  const PetscInt stash = d[0], runs = d[1], groups = d[2];
  const PetscInt* const run = d + 3;
  const std::size_t width = columns.size();
  d = run + 3 * runs;
  fetch(d, run, runs, groups);
  for (PetscInt g = 0; g < groups; ++g, d += 3 + runs)
    for (PetscInt i = 0; i < d[1]; ++i)
    {
      PetscScalar* const row[2] = {begin(0, d[2] + i), begin(1, d[2] + i)};
      const double* const from = values + (d[0] + i) * width;
      for (PetscInt k = 0; k < runs; ++k)
      {
        const PetscInt* const r = run + 3 * k;
        PetscScalar* const to = row[r[2]] + d[3 + k];
        for (PetscInt j = 0; j < r[1]; ++j)
          to[j] += from[r[0] + j];
      }
    }
  if (not stash)
    return;
  _stashed.assign(rows.begin(), rows.end());
  for (PetscInt& r : _stashed)
    if (_own.has(r))
      r = -1;
  add_once(_stashed, columns, values);
}

void BlockAdder::add_once(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
                          const double* values) const
{
  check(MatSetValues(_matrix, rows.size(), rows.data(), columns.size(), columns.data(), values,
                     ADD_VALUES),
        "MatSetValues (contact tangent)");
}

} // namespace dolfinx_contact
