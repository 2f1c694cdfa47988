// SPDX-License-Identifier: MIT
#include "remote_rows.h"

#include "../parallel/mail.h"
#include "events.h"

#include <algorithm>
#include <exception>
#include <utility>

namespace dolfinx_contact
{

RemoteRows::RemoteRows(MPI_Comm comm, std::vector<PetscInt> starts, std::vector<PetscInt> rows,
                       std::vector<std::size_t> offset, std::vector<PetscInt> columns)
    : _comm(comm)
    , _starts(std::move(starts))
    , _rows(std::move(rows))
    , _columns(std::move(columns))
    , _offset(std::move(offset))
    , _values(_columns.size(), 0.0)
{
}

void RemoteRows::zero()
{
  std::fill(_values.begin(), _values.end(), 0.0);
}

PetscInt RemoteRows::find(PetscInt row) const
{
  const auto it = std::lower_bound(_rows.begin(), _rows.end(), row);
  return it == _rows.end() or *it != row ? -1 : static_cast<PetscInt>(it - _rows.begin());
}

PetscInt RemoteRows::place(PetscInt row, PetscInt column, PetscInt length) const
{
  const PetscInt *const begin = _columns.data() + _offset[row], *const end = _columns.data()
                                                                             + _offset[row + 1];
  const PetscInt* const it = std::lower_bound(begin, end, column);
  const bool there = end - it >= length and *it == column and it[length - 1] == column + length - 1;
  return there ? static_cast<PetscInt>(it - begin) : -1;
}

void RemoteRows::send(Mat A)
{
  if (_starts.size() <= 2) // one rank
    return;
  const Logged logged(Event::sending);
  std::string error;
  try
  {
    if (not _own.open(A))
      error = "contact tangent: rows of other ranks go into AIJ matrices that are assembled";
  }
  catch (const std::exception& e)
  {
    error = e.what();
  }
  int state = not error.empty() ? 2 : _own.same() ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &state, 1, MPI_INT, MPI_MAX, _comm);
  bytes_in += sizeof(int);
  try
  {
    if (state == 2)
      throw_together(_comm, error);
    if (state == 1)
      find_targets();
  }
  catch (...)
  {
    _own.close();
    _own = {}; // targets are to be found anew
    throw;
  }

  MPI_Alltoallv(_values.data(), _sent.size.data(), _sent.offset.data(), MPI_DOUBLE, _inbox.data(),
                _received.size.data(), _received.offset.data(), MPI_DOUBLE, _comm);
  bytes_in += sizeof(double) * _inbox.size();
  const PetscScalar* from = _inbox.data();
  for (const Target& t : _targets)
  {
    PetscScalar* const to = _own.values(t.part, t.row) + t.place;
    for (PetscInt j = 0; j < t.length; ++j)
      to[j] += *from++;
  }
  _own.close();
}

// Tell the owners which entries they get: for rows that follow one another and have the same
// columns the first, their number, the number of runs of columns, and each run's first and length.
void RemoteRows::find_targets()
{
  const int ranks = static_cast<int>(_starts.size()) - 1;
  std::vector<std::vector<std::int64_t>> out(ranks);
  std::vector<std::int64_t> count(ranks, 0);
  const auto columns = [&](std::size_t k)
  { return std::span(_columns).subspan(_offset[k], _offset[k + 1] - _offset[k]); };
  for (std::size_t k = 0, next; k < _rows.size(); k = next)
  {
    const auto end = std::upper_bound(_starts.begin(), _starts.end(), _rows[k]);
    const std::span<const PetscInt> mine = columns(k);
    for (next = k + 1; next < _rows.size() and _rows[next] == _rows[next - 1] + 1
                       and _rows[next] < *end and std::ranges::equal(columns(next), mine);)
      ++next;
    const std::size_t owner = end - _starts.begin() - 1;
    std::vector<std::int64_t>& to = out[owner];
    to.insert(to.end(), {_rows[k], static_cast<std::int64_t>(next - k), 0});
    const std::size_t runs = to.size() - 1;
    for (std::size_t c = 0, size; c < mine.size(); c += size, ++to[runs])
    {
      for (size = 1; c + size < mine.size() and mine[c + size] == mine[c + size - 1] + 1;)
        ++size;
      to.insert(to.end(), {mine[c], static_cast<std::int64_t>(size)});
    }
    count[owner] += std::ssize(mine) * static_cast<std::int64_t>(next - k);
  }
  const Mail<std::int64_t> mail = all_to_all(_comm, out);

  std::string error;
  std::vector<std::int64_t> received(ranks, 0);
  _targets.clear();
  for (int r = 0; r < ranks; ++r)
    for (auto it = mail.from(r).begin(); it != mail.from(r).end();)
    {
      const auto row = static_cast<PetscInt>(it[0] - _own.first());
      const auto rows = static_cast<PetscInt>(it[1]);
      const std::span runs(it + 3, 2 * it[2]);
      it = it + 3 + 2 * it[2];
      for (PetscInt i = row; i < row + rows; ++i)
        for (std::size_t k = 0; k < runs.size(); k += 2)
        {
          received[r] += runs[k + 1];
          PetscInt column = static_cast<PetscInt>(runs[k]);
          const PetscInt last = column + static_cast<PetscInt>(runs[k + 1]);
          for (PetscInt length; column < last; column += length)
          {
            for (length = 1;
                 column + length < last and _own.part(column + length) == _own.part(column);)
              ++length;
            const PetscInt place = _own.place(i, column, length);
            if (place < 0 and error.empty())
              error = "contact tangent: the matrix has no place for row "
                      + std::to_string(_own.first() + i) + ", columns from "
                      + std::to_string(column) + ", to which another rank adds";
            _targets.push_back({i, place, length, _own.part(column)});
          }
        }
    }
  const auto offsets = [&](const std::vector<std::int64_t>& counts, Counts& to)
  {
    to.size.assign(counts.begin(), counts.end());
    to.offset.assign(ranks, 0);
    const std::int64_t all = std::reduce(counts.begin(), counts.end());
    if (all > std::numeric_limits<int>::max())
      error = "contact tangent: one rank would exchange " + std::to_string(all)
              + " entries, MPI can count 2147483647; use more ranks";
    else
      std::partial_sum(to.size.begin(), to.size.end() - 1, to.offset.begin() + 1);
    return static_cast<std::size_t>(all);
  };
  offsets(count, _sent);
  _inbox.resize(offsets(received, _received));
  throw_together(_comm, error);
}

} // namespace dolfinx_contact
