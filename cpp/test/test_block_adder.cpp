// SPDX-License-Identifier: MIT
//
// Blocks added by kept places against MatSetValues, on all ranks of the run.
#include "../assembly/block_adder.h"
#include "../assembly/pattern.h"
#include "../assembly/petsc_check.h"

#include <catch2/catch.hpp>
#include <numeric>
#include <random>

using namespace dolfinx_contact;

namespace
{

struct Block
{
  BlockAdder::Name name;
  std::vector<PetscInt> rows, columns;
};

/// Blocks of nodes with three dofs each and of single unknowns, numbered over all ranks; some held.
std::vector<Block> blocks(PetscInt size, unsigned seed)
{
  std::mt19937 random(seed);
  std::vector<PetscInt> nodes(size / 3);
  std::iota(nodes.begin(), nodes.end(), 0);
  auto dofs = [&](int n)
  {
    std::shuffle(nodes.begin(), nodes.end(), random);
    std::vector<PetscInt> out;
    for (int a = 0; a < n; ++a)
      for (int i = 0; i < (a + 1 < n ? 3 : 1); ++i)
        out.push_back(random() % 7 == 0 ? -1 : 3 * nodes[a] + i);
    return out;
  };
  std::vector<Block> out;
  for (int f = 0; f < 20; ++f)
    for (int kind = 0; kind < 2; ++kind)
      for (int target = -1; target < 2; ++target)
        out.push_back({{f, target, kind}, dofs(5), dofs(4 + kind)});
  return out;
}

/// An AIJ matrix of the given local size with the pattern of the blocks.
Mat matrix(PetscInt local, const std::vector<Block>& blocks)
{
  Mat record, A;
  for (Mat* M : {&record, &A})
  {
    check(MatCreate(PETSC_COMM_WORLD, M), "MatCreate");
    check(MatSetSizes(*M, local, local, PETSC_DETERMINE, PETSC_DETERMINE), "MatSetSizes");
    check(MatSetType(*M, M == &A ? MATAIJ : MATPREALLOCATOR), "MatSetType");
  }
  check(MatSetUp(record), "MatSetUp");
  for (const Block& b : blocks)
  {
    const std::vector<double> zeros(b.rows.size() * b.columns.size(), 0.0);
    check(MatSetValues(record, b.rows.size(), b.rows.data(), b.columns.size(), b.columns.data(),
                       zeros.data(), ADD_VALUES),
          "MatSetValues");
  }
  check(MatAssemblyBegin(record, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  check(MatAssemblyEnd(record, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
  check(MatPreallocatorPreallocate(record, PETSC_TRUE, A), "MatPreallocatorPreallocate");
  check(MatSetOption(A, MAT_NEW_NONZERO_LOCATION_ERR, PETSC_TRUE), "MatSetOption");
  check(MatDestroy(&record), "MatDestroy");
  return A;
}

void assemble(Mat A)
{
  check(MatAssemblyBegin(A, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  check(MatAssemblyEnd(A, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
}

double norm(Mat A)
{
  double out;
  check(MatNorm(A, NORM_FROBENIUS, &out), "MatNorm");
  return out;
}

/// Rows of other ranks that the blocks have.
RemoteRows remote_rows(PetscInt local, const std::vector<Block>& blocks)
{
  Pattern pattern(PETSC_COMM_WORLD, local);
  for (const Block& b : blocks)
    pattern.add(b.rows, b.columns);
  pattern.finish();
  return pattern.remote_rows();
}

/// Norm of the difference of the two ways to add the blocks `times` over.
double difference(BlockAdder& adder, Mat A, const std::vector<Block>& blocks, int times,
                  RemoteRows* remote = nullptr)
{
  Mat B;
  check(MatDuplicate(A, MAT_COPY_VALUES, &B), "MatDuplicate");
  std::mt19937 random(3);
  std::uniform_real_distribution<double> number(-1, 1);
  for (int t = 0; t < times; ++t)
  {
    if (remote)
      remote->zero();
    adder.open(A, remote);
    for (const Block& b : blocks)
    {
      std::vector<double> values(b.rows.size() * b.columns.size());
      for (double& v : values)
        v = number(random);
      adder.add(b.name, b.rows, b.columns, values.data());
      check(MatSetValues(B, b.rows.size(), b.rows.data(), b.columns.size(), b.columns.data(),
                         values.data(), ADD_VALUES),
            "MatSetValues");
    }
    adder.close();
    if (remote)
      remote->send(A);
    assemble(A);
    assemble(B);
  }
  REQUIRE(norm(A) > 1);
  check(MatAXPY(B, -1, A, SAME_NONZERO_PATTERN), "MatAXPY");
  const double out = norm(B);
  check(MatDestroy(&B), "MatDestroy");
  return out;
}

} // namespace

TEST_CASE("BlockAdder: the same as MatSetValues, again and again")
{
  int rank, size;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  const PetscInt local = 90 - 30 * (rank == 1); // columns and rows of all ranks in each block
  const PetscInt n = 90 * size - 30 * (size > 1);
  BlockAdder adder;
  for (unsigned seed : {1, 2}) // another matrix: its places are found anew
  {
    const std::vector<Block> all = blocks(n, 10 * seed + rank);
    Mat A = matrix(local, all);
    REQUIRE(difference(adder, A, all, 3) <= 1e-12);
    REQUIRE(difference(adder, A, {all.rbegin(), all.rend()}, 1) <= 1e-12);
    check(MatDestroy(&A), "MatDestroy");
  }
}

TEST_CASE("RemoteRows: the same as MatSetValues, in one matrix and the other")
{
  int rank, size;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  const PetscInt local = 90 - 30 * (rank == 1), n = 90 * size - 30 * (size > 1);
  const std::vector<Block> all = blocks(n, 30 + rank);
  std::vector<Block> more = blocks(n, 40 + rank);
  more.insert(more.end(), all.begin(), all.end());
  RemoteRows remote = remote_rows(local, all);
  REQUIRE((remote.size() > 0) == (size > 1));
  Mat A = matrix(local, all), B = matrix(local, more);
  BlockAdder adder;
  REQUIRE(difference(adder, A, all, 2, &remote) <= 1e-12);
  REQUIRE(difference(adder, B, all, 2, &remote) <= 1e-12); // its places are others
  REQUIRE(difference(adder, A, all, 1, &remote) <= 1e-12);
  REQUIRE(difference(adder, A, all, 1) <= 1e-12); // and as PETSc does it, again
  check(MatDestroy(&A), "MatDestroy");
  check(MatDestroy(&B), "MatDestroy");
}

TEST_CASE(
    "RemoteRows: no place in the owner's rows is an error of all ranks, mended by another matrix")
{
  int rank, size;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  if (size == 1)
  {
    RemoteRows none = remote_rows(90, blocks(90, 1));
    REQUIRE(none.size() == 0);
    REQUIRE_NOTHROW(none.send(nullptr));
    return;
  }
  const PetscInt n = 6 * size;
  // each rank adds to the next one's first row; the last rank in a column that the row lacks
  const std::vector<PetscInt> row{6 * ((rank + 1) % size)}, own{6 * rank + 1};
  const std::vector<PetscInt> columns{0, n - 1 - (rank == size - 1)};
  const Block there{{0, 0, 0}, row, {0}}, beside{{0, 0, 1}, row, columns},
      mine{{1, 0, 0}, own, own};
  RemoteRows remote = remote_rows(6, {beside});
  const bool wrong = rank == size - 1;
  Mat A = matrix(6, {wrong ? there : beside, mine}), B = matrix(6, {beside, mine});
  BlockAdder adder;
  REQUIRE_THROWS_AS(remote.send(A), std::invalid_argument);
  REQUIRE(difference(adder, B, {beside, mine}, 2, &remote) <= 1e-12);
  // a row that it does not have
  adder.open(B, &remote);
  const std::vector<PetscInt> other{6 * ((rank + 1) % size) + 2};
  const double one = 1;
  REQUIRE_THROWS_AS(adder.add({2, 0, 0}, other, own, &one), std::runtime_error);
  adder.close();
  check(MatDestroy(&A), "MatDestroy");
  check(MatDestroy(&B), "MatDestroy");
}

TEST_CASE("BlockAdder: other columns of the same blocks after `forget`")
{
  int size;
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  std::vector<Block> first = blocks(90 * size, 5), both = first, second = blocks(90 * size, 6);
  both.insert(both.end(), second.begin(), second.end());
  Mat A = matrix(90, both);
  BlockAdder adder;
  REQUIRE(difference(adder, A, first, 1) <= 1e-12);
  adder.forget();
  REQUIRE(difference(adder, A, second, 1) <= 1e-12);
  check(MatDestroy(&A), "MatDestroy");
}

TEST_CASE("BlockAdder: an entry without a place is an error, and nothing is added")
{
  Mat A;
  check(MatCreateSeqAIJ(PETSC_COMM_SELF, 6, 6, 2, nullptr, &A), "MatCreateSeqAIJ");
  for (PetscInt i = 0; i < 6; ++i)
    check(MatSetValue(A, i, i, 1, INSERT_VALUES), "MatSetValue");
  assemble(A);
  BlockAdder adder;
  const std::vector<PetscInt> rows{3, 4};
  const std::vector<double> ones(4, 1.0);
  for (int again = 0; again < 2; ++again)
  {
    adder.open(A);
    REQUIRE_THROWS_AS(adder.add({0, 0, 0}, rows, rows, ones.data()), std::runtime_error);
    adder.close();
  }
  REQUIRE(norm(A) == Approx(std::sqrt(6)));
  check(MatDestroy(&A), "MatDestroy");
}

TEST_CASE("BlockAdder: into a dense matrix, through PETSc")
{
  const std::vector<Block> all = blocks(90, 4);
  Mat A;
  check(MatCreateSeqDense(PETSC_COMM_SELF, 90, 90, nullptr, &A), "MatCreateSeqDense");
  assemble(A);
  BlockAdder adder;
  REQUIRE(difference(adder, A, all, 2) <= 1e-12);
  check(MatDestroy(&A), "MatDestroy");
}
