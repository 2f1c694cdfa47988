// SPDX-License-Identifier: MIT
#include "pattern.h"

#include "../parallel/mail.h"
#include "petsc_check.h"

#include <array>
#include <iterator>
#include <utility>

namespace dolfinx_contact
{

Pattern::Pattern(MPI_Comm comm, PetscInt owned)
    : _comm(comm)
    , _owned(owned)
    , _starts(comm_size(comm) + 1, 0)
{
  const std::int64_t n = owned;
  MPI_Allgather(&n, 1, MPI_INT64_T, _starts.data() + 1, 1, MPI_INT64_T, comm);
  std::partial_sum(_starts.begin(), _starts.end(), _starts.begin());
  _start = static_cast<PetscInt>(_starts[comm_rank(comm)]);
}

// Add columns to the last block.
void Pattern::add_run(PetscInt first, PetscInt size)
{
  for (const PetscInt border : {_start, _start + _owned})
    if (first < border and first + size > border)
    {
      _columns.data.push_back({first, border - first});
      size -= border - first;
      first = border;
    }
  _columns.data.push_back({first, size});
}

void Pattern::add(std::span<const PetscInt> rows, std::span<const PetscInt> columns)
{
  for (const PetscInt row : rows)
    if (row >= 0)
      _rows.data.push_back(row);
  for (std::size_t c = 0, size; c < columns.size(); c += size)
  {
    size = 1;
    if (columns[c] < 0)
      continue;
    while (c + size < columns.size()
           and columns[c + size] == columns[c] + static_cast<PetscInt>(size))
      ++size;
    add_run(columns[c], size);
  }
  _rows.close();
  _columns.close();
}

void Pattern::add_sparse(PetscInt first, PetscInt block_rows, std::span<const std::int64_t> offset,
                         std::span<const PetscInt> columns, PetscInt block_columns)
{
  for (std::size_t r = 0; r + 1 < offset.size(); ++r)
  {
    for (PetscInt i = 0; i < block_rows; ++i)
      _rows.data.push_back(first++);
    for (std::int64_t k = offset[r]; k < offset[r + 1]; ++k)
      add_run(columns[k], block_columns);
    _rows.close();
    _columns.close();
  }
}

void Pattern::finish()
{
  const int mine = _rows.size();
  std::copy_if(_rows.data.begin(), _rows.data.end(), std::back_inserter(_remote),
               [&](PetscInt row) { return not own(row); });
  std::sort(_remote.begin(), _remote.end());
  _remote.erase(std::unique(_remote.begin(), _remote.end()), _remote.end());
  send_rows();
  number_columns();
  _united = unite(blocks_of_rows(_rows.size(), _owned,
                                 [&](PetscInt row) { return own(row) ? row - _start : -1; }),
                  true);
  const auto number = [&](PetscInt row)
  {
    if (own(row))
      return PetscInt(-1);
    const auto it = std::lower_bound(_remote.begin(), _remote.end(), row);
    return static_cast<PetscInt>(it - _remote.begin());
  };
  if (not _remote.empty())
    _united_remote
        = unite(blocks_of_rows(mine, static_cast<PetscInt>(_remote.size()), number), false);
  _rows = {};
  _columns = {};
}

// Blocks with rows of other ranks, to these: numbers of rows and of runs, the rows, the runs.
void Pattern::send_rows()
{
  const int ranks = comm_size(_comm);
  if (ranks == 1)
    return;
  std::vector<std::vector<std::int64_t>> out(ranks);
  std::vector<std::array<PetscInt, 2>> rows; // rank, row
  for (int b = 0; b < _rows.size(); ++b)
  {
    rows.clear();
    for (const PetscInt row : _rows[b])
      if (not own(row))
      {
        const auto after = std::upper_bound(_starts.begin(), _starts.end(), row);
        rows.push_back({static_cast<PetscInt>(after - _starts.begin()) - 1, row});
      }
    std::sort(rows.begin(), rows.end());
    for (std::size_t begin = 0, end; begin < rows.size(); begin = end)
    {
      for (end = begin; end < rows.size() and rows[end][0] == rows[begin][0];)
        ++end;
      std::vector<std::int64_t>& to = out[rows[begin][0]];
      const std::span<const Run> runs = _columns[b];
      to.insert(to.end(), {static_cast<std::int64_t>(end - begin), std::ssize(runs)});
      for (std::size_t k = begin; k < end; ++k)
        to.push_back(rows[k][1]);
      for (const Run& run : runs)
        to.insert(to.end(), {run.first, run.size});
    }
  }
  const Mail<std::int64_t> mail = all_to_all(_comm, out);
  for (auto it = mail.data.begin(); it != mail.data.end();)
  {
    std::int64_t num_rows = *it++, num_runs = *it++;
    while (num_rows-- > 0)
      _rows.data.push_back(static_cast<PetscInt>(*it++));
    for (; num_runs > 0; --num_runs, it += 2)
      add_run(static_cast<PetscInt>(it[0]), static_cast<PetscInt>(it[1]));
    _rows.close();
    _columns.close();
  }
}

// Runs in local numbers: the own columns, then those of other ranks that occur. A run stays one.
void Pattern::number_columns()
{
  std::vector<std::pair<PetscInt, std::size_t>> others; // first column, run
  for (std::size_t k = 0; k < _columns.data.size(); ++k)
    if (Run& run = _columns.data[k]; own(run.first))
      run.first -= _start;
    else
      others.push_back({run.first, k});
  std::sort(others.begin(), others.end());
  PetscInt end = 0; // of the columns so far
  for (const auto& [first, k] : others)
  {
    Run& run = _columns.data[k];
    for (end = std::max(end, first); end < first + run.size; ++end)
      _others.push_back(end);
    run.first = _owned + static_cast<PetscInt>(_others.size()) - (end - first);
  }
}

// The first blocks' numbers, for each of some rows.
// @param number of a global row among these, or −1
template <typename Number>
Pattern::Lists<std::int32_t> Pattern::blocks_of_rows(int num_blocks, PetscInt num_rows,
                                                     Number number) const
{
  Lists<std::int32_t> out;
  std::vector<std::size_t>& offset = out.offset;
  offset.assign(num_rows + 2, 0);
  const std::size_t end = _rows.offset[num_blocks];
  std::vector<PetscInt> numbers(end);
  std::transform(_rows.data.begin(), _rows.data.begin() + end, numbers.begin(), number);
  for (const PetscInt n : numbers)
    if (n >= 0)
      ++offset[n + 2];
  std::partial_sum(offset.begin(), offset.end(), offset.begin());
  out.data.resize(offset.back());
  for (int b = 0; b < num_blocks; ++b)
    for (std::size_t k = _rows.offset[b]; k < _rows.offset[b + 1]; ++k)
      if (numbers[k] >= 0)
        out.data[offset[numbers[k] + 1]++] = b;
  offset.pop_back();
  return out;
}

// The union of the blocks' columns in each row; with the diagonal, if rows are this rank's.
Pattern::Rows Pattern::unite(const Lists<std::int32_t>& blocks, bool diagonal) const
{
  Rows out;
  // per column: the last group that has a run from here, and the end of its longest one
  std::vector<PetscInt> group(_owned + _others.size(), -1), end(group.size());
  std::vector<PetscInt> firsts;
  std::vector<Run> runs;
  const auto has = [&](PetscInt row)
  {
    const auto after = std::upper_bound(runs.begin(), runs.end(), row,
                                        [](PetscInt r, const Run& run) { return r < run.first; });
    return after != runs.begin() and row < after[-1].first + after[-1].size;
  };
  bool shared = false; // the last group can have more rows
  for (PetscInt row = 0; row < blocks.size(); ++row)
  {
    const std::span<const std::int32_t> mine = blocks[row];
    if (shared)
      if (const auto last = blocks[row - 1];
          std::equal(mine.begin(), mine.end(), last.begin(), last.end())
          and (not diagonal or has(row)))
        continue;
    const PetscInt g = out.columns.size();
    const auto meet = [&](const Run& run)
    {
      if (std::exchange(group[run.first], g) != g)
      {
        firsts.push_back(run.first);
        end[run.first] = 0;
      }
      end[run.first] = std::max(end[run.first], run.first + run.size);
    };
    const auto sweep = [&]
    {
      std::sort(firsts.begin(), firsts.end());
      runs.clear();
      for (const PetscInt first : firsts)
        if (not runs.empty() and first <= runs.back().first + runs.back().size
            and first != _owned) // own columns and others are apart
          runs.back().size = std::max(runs.back().size, end[first] - runs.back().first);
        else
          runs.push_back({first, end[first] - first});
    };
    firsts.clear();
    for (const std::int32_t b : mine)
      for (const Run& run : _columns[b])
        meet(run);
    sweep();
    shared = not diagonal or has(row);
    if (not shared)
    {
      meet({row, 1});
      sweep();
    }
    out.first.push_back(row);
    out.columns.data.insert(out.columns.data.end(), runs.begin(), runs.end());
    out.columns.close();
  }
  out.first.push_back(blocks.size());
  return out;
}

RemoteRows Pattern::remote_rows() const
{
  std::vector<PetscInt> columns;
  std::vector<std::size_t> offset{0};
  for (int g = 0; g < _united_remote.columns.size(); ++g)
  {
    const std::size_t begin = columns.size();
    for (const Run& run : _united_remote.columns[g])
      for (PetscInt c = run.first; c < run.first + run.size; ++c)
        columns.push_back(global(c));
    std::sort(columns.begin() + begin, columns.end());
    const std::size_t size = columns.size() - begin;
    for (PetscInt row = _united_remote.first[g]; row < _united_remote.first[g + 1]; ++row)
      offset.push_back(begin + (row - _united_remote.first[g] + 1) * size);
    for (std::size_t k = begin; columns.size() < offset.back(); ++k)
      columns.push_back(columns[k]);
  }
  return {_comm, {_starts.begin(), _starts.end()}, _remote, std::move(offset), std::move(columns)};
}

void Pattern::allocate(Mat A) const
{
  std::vector<PetscInt> own(_owned), other(_owned);
  for (int g = 0; g < _united.columns.size(); ++g)
  {
    const PetscInt first = _united.first[g], last = _united.first[g + 1];
    PetscInt count[2] = {0, 0};
    for (const Run& run : _united.columns[g])
      count[run.first >= _owned] += run.size;
    std::fill(own.begin() + first, own.begin() + last, count[0]);
    std::fill(other.begin() + first, other.begin() + last, count[1]);
  }
  // each does nothing to a matrix of the other type
  check(MatSeqAIJSetPreallocation(A, 0, own.data()), "MatSeqAIJSetPreallocation");
  check(MatMPIAIJSetPreallocation(A, 0, own.data(), 0, other.data()), "MatMPIAIJSetPreallocation");
  check(MatSetOption(A, MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_TRUE), "MatSetOption");
}

void Pattern::fill(Mat A) const
{
  std::vector<PetscInt> columns;
  std::vector<PetscScalar> zeros;
  for (int g = 0; g < _united.columns.size(); ++g)
  {
    columns.clear();
    for (const Run& run : _united.columns[g])
      for (PetscInt c = run.first; c < run.first + run.size; ++c)
        columns.push_back(global(c));
    if (zeros.size() < columns.size())
      zeros.resize(columns.size(), 0.0);
    for (PetscInt row = _start + _united.first[g]; row < _start + _united.first[g + 1]; ++row)
      check(MatSetValues(A, 1, &row, columns.size(), columns.data(), zeros.data(), INSERT_VALUES),
            "MatSetValues (pattern)");
  }
  check(MatAssemblyBegin(A, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  check(MatAssemblyEnd(A, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
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
