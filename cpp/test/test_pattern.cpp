// SPDX-License-Identifier: MIT
//
// Places of random blocks against sets, on all ranks of the run.
#include "../assembly/pattern.h"
#include "../assembly/petsc_check.h"
#include "../parallel/mail.h"

#include <catch2/catch.hpp>
#include <random>
#include <set>

using namespace dolfinx_contact;

namespace
{

using Place = std::pair<PetscInt, PetscInt>;

struct Block
{
  std::vector<PetscInt> rows, columns;
};

/// Blocks of consecutive unknowns, numbered over all ranks; some are held, some occur twice.
std::vector<Block> blocks(PetscInt size, unsigned seed, int count)
{
  std::mt19937 random(seed);
  auto dofs = [&](int runs)
  {
    std::vector<PetscInt> out;
    for (int k = 0; k < runs; ++k)
    {
      const PetscInt first = random() % size, length = 1 + random() % 4;
      for (PetscInt i = first; i < std::min(size, first + length); ++i)
        out.push_back(random() % 7 == 0 ? -1 : i);
    }
    return out;
  };
  std::vector<Block> out;
  for (int b = 0; b < count; ++b)
    out.push_back({dofs(random() % 4), dofs(random() % 6)});
  return out;
}

/// The places of all ranks' blocks and of the diagonal in this rank's rows.
std::set<Place> expected(PetscInt first, PetscInt last, const std::vector<std::vector<Block>>& all)
{
  std::set<Place> out;
  for (PetscInt row = first; row < last; ++row)
    out.insert({row, row});
  for (const std::vector<Block>& of_rank : all)
    for (const Block& b : of_rank)
      for (const PetscInt row : b.rows)
        for (const PetscInt column : b.columns)
          if (row >= first and row < last and column >= 0)
            out.insert({row, column});
  return out;
}

std::set<Place> places(Mat A)
{
  PetscInt first, last;
  check(MatGetOwnershipRange(A, &first, &last), "MatGetOwnershipRange");
  std::set<Place> out;
  for (PetscInt row = first; row < last; ++row)
  {
    PetscInt n;
    const PetscInt* columns;
    check(MatGetRow(A, row, &n, &columns, nullptr), "MatGetRow");
    for (PetscInt k = 0; k < n; ++k)
      REQUIRE(out.insert({row, columns[k]}).second);
    check(MatRestoreRow(A, row, &n, &columns, nullptr), "MatRestoreRow");
  }
  return out;
}

} // namespace

TEST_CASE("Pattern: the places of all ranks' blocks, no others, again and again in one matrix")
{
  const int rank = comm_rank(PETSC_COMM_WORLD), size = comm_size(PETSC_COMM_WORLD);
  const auto owned = [](int r) { return r == 1 ? 0 : 40 + r; }; // one rank has nothing
  PetscInt first = 0, n = 0;
  for (int r = 0; r < size; ++r)
  {
    first += r < rank ? owned(r) : 0;
    n += owned(r);
  }
  Mat A;
  check(MatCreate(PETSC_COMM_WORLD, &A), "MatCreate");
  check(MatSetSizes(A, owned(rank), owned(rank), PETSC_DETERMINE, PETSC_DETERMINE), "MatSetSizes");
  check(MatSetType(A, MATAIJ), "MatSetType");
  for (const int count : {0, 3, 30})
  {
    std::vector<std::vector<Block>> all; // each rank knows those of all
    for (int r = 0; r < size; ++r)
      all.push_back(blocks(n, 10 * count + r, count));
    Pattern pattern(PETSC_COMM_WORLD, owned(rank));
    for (const Block& b : all[rank])
      pattern.add(b.rows, b.columns);
    pattern.finish();
    pattern.allocate(A);
    pattern.fill(A);
    REQUIRE(places(A) == expected(first, first + owned(rank), all));
    MatInfo info;
    check(MatGetInfo(A, MAT_LOCAL, &info), "MatGetInfo");
    REQUIRE(info.nz_allocated == info.nz_used);
    REQUIRE(info.mallocs == 0);
  }
  check(MatDestroy(&A), "MatDestroy");
}

TEST_CASE("Pattern: a sparse matrix of small blocks")
{
  const int rank = comm_rank(PETSC_COMM_WORLD), size = comm_size(PETSC_COMM_WORLD);
  const PetscInt owned = 30, start = 30 * rank, n = 30 * size;
  Pattern pattern(PETSC_COMM_WORLD, owned);
  // rows of 3 in the middle of this rank's, columns of 2, also of other ranks
  const std::vector<std::int64_t> offset{0, 2, 2, 5};
  const std::vector<PetscInt> columns{4, (start + 29) % (n - 1), 0, 6, n - 2};
  pattern.add_sparse(start + 10, 3, offset, columns, 2);
  pattern.finish();
  Mat A;
  check(MatCreate(PETSC_COMM_WORLD, &A), "MatCreate");
  check(MatSetSizes(A, owned, owned, PETSC_DETERMINE, PETSC_DETERMINE), "MatSetSizes");
  check(MatSetType(A, MATAIJ), "MatSetType");
  pattern.allocate(A);
  pattern.fill(A);
  std::vector<Block> same;
  for (PetscInt r = 0; r < 3; ++r)
    for (std::int64_t k = offset[r]; k < offset[r + 1]; ++k)
    {
      const PetscInt row = start + 10 + 3 * r;
      same.push_back({{row, row + 1, row + 2}, {columns[k], columns[k] + 1}});
    }
  REQUIRE(places(A) == expected(start, start + owned, {same}));
  check(MatDestroy(&A), "MatDestroy");
}
