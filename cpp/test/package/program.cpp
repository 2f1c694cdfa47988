// SPDX-License-Identifier: MIT
// The installed library, from a program outside: headers, linking and numbers.
#include <cmath>
#include <dolfinx_contact/assembly/assembler.h>
#include <dolfinx_contact/integration/particle_rule.h>
#include <dolfinx_contact/material/j2_plasticity.h>
#include <iostream>
#include <numeric>

using namespace dolfinx_contact;

int main(int argc, char** argv)
{
  if (PetscInitialize(&argc, &argv, nullptr, nullptr) != 0)
    return 1;

  // Simpson's rule on [0, 1]
  const ParticleRule rule = simpson(Shape::interval, 0);
  double cubic = 0;
  for (int p = 0; p < rule.size(); ++p)
    cubic += rule.weights[p] * std::pow(rule.points[p], 3);
  bool right = std::abs(cubic - 0.25) < 1e-15;

  // Uniaxial stretch below the yield stress: τ_0 = (λ + 2μ) log 2
  const std::vector<double> F{2, 0, 0, 0, 1, 0, 0, 0, 1}, cp{1, 1, 1, 0, 0, 0}, ep{0};
  std::vector<double> cp_new(6), ep_new(1), tau(6), P(9), A(81);
  const int failed
      = update({1, 0.5}, Voce{1e3, 0, 0, 0}, 9, F, {cp, ep}, {{cp_new, ep_new}, tau, P, A});
  right = right and failed == 0 and std::abs(tau[0] - 2 * std::log(2.0)) < 1e-14;

  // PETSc is linked with it
  Vec x;
  PetscReal norm = 0;
  VecCreateMPI(PETSC_COMM_WORLD, 4, PETSC_DETERMINE, &x);
  VecSet(x, 0.5);
  VecNorm(x, NORM_2, &norm);
  VecDestroy(&x);
  right = right and norm == 1;
  PetscFinalize();

  std::cout << (right ? "right" : "wrong") << std::endl;
  return right ? 0 : 1;
}
