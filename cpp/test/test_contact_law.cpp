// SPDX-License-Identifier: MIT
#include "../mechanics/contact_law.h"
#include "facets.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

TEST_CASE("ContactLaw: status and traction")
{
  const ContactLaw law{10, false}, augmented{10, true};
  REQUIRE(closed(law, -1, 0));
  REQUIRE(closed(law, 0, 0.1));
  REQUIRE(closed(law, -1, -0.099));
  REQUIRE_FALSE(closed(law, -1, -0.101));
  REQUIRE_FALSE(closed(law, 0, 0));          // χ is the indicator of the negative reals
  REQUIRE_FALSE(closed(law, -1, -INFINITY)); // no target
  const Vector<2> n(0.6, 0.8);
  REQUIRE(traction<2>(law, true, -2, n, 0.1) == Vector<2>(-2 * n));
  REQUIRE(traction<2>(augmented, true, -2, n, 0.1) == Vector<2>(-3 * n));
  REQUIRE(traction<2>(augmented, false, -2, n, 0.1) == Vector<2>::Zero());
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: the linearised traction is the traction's derivative", "",
                       ((int D), D), 2, 3)
{
  constexpr int Z = Kinematics<D>::Z;
  std::mt19937 random(3);
  for (bool augmented : {false, true})
  {
    const ContactLaw law{2.3, augmented};
    Kinematics<D> k;
    k.n = uniform_vector<D>(random, -1, 1).normalized();
    k.gap = 0.17;
    for (int j = 0; j < Z; ++j)
    {
      k.dn.col(j) = uniform_vector<D>(random, -1, 1);
      k.dgap[j] = uniform(random, -1, 1);
    }
    const double lambda = -1.4;
    const Traction<D> out = linearised_traction<D>(law, lambda, k);
    REQUIRE(out.t == traction<D>(law, true, lambda, k.n, k.gap));

    // t is quadratic in (λ, n, d_n): central differences have no truncation, hence a large step
    const double h = 0.5, tol = 20 * eps / h;
    auto at = [&](double s, const Vector<D>& dn, double dgap, double dlambda)
    {
      const Vector<D> n = k.n + s * dn;
      return traction<D>(law, true, lambda + s * dlambda, n, k.gap + s * dgap);
    };
    auto derivative = [&](const Vector<D>& dn, double dgap, double dlambda)
    { return Vector<D>((at(h, dn, dgap, dlambda) - at(-h, dn, dgap, dlambda)) / (2 * h)); };
    for (int j = 0; j < Z; ++j)
      REQUIRE((out.dz.col(j) - derivative(k.dn.col(j), k.dgap[j], 0)).norm() <= tol);
    REQUIRE((out.dlambda - derivative(Vector<D>::Zero(), 0, 1)).norm() <= tol);
    REQUIRE(out.dz.norm() > 1);
    REQUIRE(out.dlambda.norm() > 0.9);
  }
}
