// SPDX-License-Identifier: MIT
// One main for all C++ tests; run it alone or under mpirun.
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <iostream>
#include <mpi.h>
#include <petscsys.h>
#include <sstream>

int main(int argc, char** argv)
{
  MPI_Init(&argc, &argv);
  if (PetscInitializeNoArguments() != 0)
    return 1;
  int rank;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);

  // Only rank 0 reports success; the others speak when something fails on them
  std::ostringstream quiet;
  std::streambuf* out = rank > 0 ? std::cout.rdbuf(quiet.rdbuf()) : nullptr;
  int failed = Catch::Session().run(argc, argv);
  if (rank > 0)
  {
    std::cout.rdbuf(out);
    if (failed)
      std::cout << "On rank " << rank << ":\n" << quiet.str() << std::flush;
  }
  MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
  PetscFinalize();
  MPI_Finalize();
  return failed;
}
