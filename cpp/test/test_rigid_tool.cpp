// SPDX-License-Identifier: MIT
//
// Rigid tools in closed form: gaps by hand and against the nearest of all points of a surface,
// derivatives against differences, special points, and composites.
#include "tool_pair.h"

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// A surface whose points have two parameters in [0, 1] (2D: one).
template <int D>
struct Known
{
  std::string name;
  typename RigidPiece<D>::Shape shape;
  std::function<Vector<D>(double, double)> point;
  bool ends = true; ///< the second parameter does not turn around
};

/// Two unit vectors that span the plane across an axis.
std::pair<Vector<3>, Vector<3>> across(const Vector<3>& axis)
{
  const Vector<3> a = axis.cross(Vector<3>(0.3, -0.5, 0.9)).normalized();
  return {a, axis.cross(a)};
}

template <int D>
std::vector<Known<D>> shapes()
{
  constexpr double turn = 2 * M_PI;
  std::vector<Known<D>> out;
  for (bool inside : {false, true})
  {
    const std::string where = inside ? ", inside" : ", outside";
    if constexpr (D == 2)
    {
      const Vector<2> c(0.3, -0.2);
      out.push_back({"circle" + where, Sphere<2>{c, 0.8, inside}, [=](double s, double) {
                       return Vector<2>(c + 0.8 * Vector<2>(cos(turn * s), sin(turn * s)));
                     }});
    }
    else
    {
      const Vector<3> c(0.3, -0.2, 0.1), axis = Vector<3>(0.2, 0.5, -0.7).normalized();
      const auto [a, b] = across(axis);
      auto around = [a = a, b = b](double s) { return Vector<3>(a * cos(s) + b * sin(s)); };
      out.push_back({"sphere" + where, Sphere<3>{c, 0.8, inside}, [=](double s, double t) {
                       return Vector<3>(c + 0.8 * sin(M_PI * t) * around(turn * s)
                                        + 0.8 * cos(M_PI * t) * axis);
                     }});
      out.push_back({"cylinder" + where, Cylinder{c, axis, 0.7, inside}, [=](double s, double t) {
                       return Vector<3>(c + 0.7 * around(turn * s) + (8 * t - 4) * axis);
                     }});
      out.push_back({"finite cylinder" + where, Cylinder{c, axis, 0.7, inside, 1.5},
                     [=](double s, double t)
                     { return Vector<3>(c + 0.7 * around(turn * s) + 1.5 * t * axis); }});
      out.push_back({"torus" + where, Torus{c, axis, 1.2, 0.4, inside},
                     [=](double s, double t)
                     {
                       const Vector<3> e = around(turn * s);
                       return Vector<3>(c + 1.2 * e + 0.4 * cos(turn * t) * e
                                        + 0.4 * sin(turn * t) * axis);
                     },
                     false});
    }
  }
  if constexpr (D == 2)
  {
    const Vector<2> n = Vector<2>(0.3, 0.8).normalized(), p(0.1, 0.2), t(-n[1], n[0]);
    out.push_back({"line", Plane<2>{p, n},
                   [=](double s, double) { return Vector<2>(p + (16 * s - 8) * t); }});
  }
  else
  {
    const Vector<3> n = Vector<3>(0.3, -0.4, 0.8).normalized(), p(0.1, 0.2, -0.3);
    const auto [a, b] = across(n);
    out.push_back({"plane", Plane<3>{p, n}, [=, a = a, b = b](double s, double t) {
                     return Vector<3>(p + (12 * s - 6) * a + (12 * t - 6) * b);
                   }});
    out.push_back({"ring", Plane<3>{p, n, 0.5, 2.0}, [=, a = a, b = b](double s, double t) {
                     return Vector<3>(p
                                      + (0.5 + 1.5 * t) * (a * cos(turn * s) + b * sin(turn * s)));
                   }});
  }
  return out;
}

/// Distance of X from a surface, by a search over its parameters on finer and finer grids.
template <int D>
double nearest(const Known<D>& known, const Vector<D>& X)
{
  double s = 0.5, t = 0.5, best = INFINITY;
  constexpr int n = 30;
  for (double half = 0.5; half > 1e-6; half *= 0.4)
  {
    const double s0 = s, t0 = t;
    for (int i = -n; i <= n; ++i)
      for (int j = D == 2 ? 0 : -n; j <= (D == 2 ? 0 : n); ++j)
      {
        const double u = s0 + half * i / n;
        double v = t0 + half * j / n;
        if (known.ends)
          v = std::clamp(v, 0.0, 1.0);
        const double d = (known.point(u, v) - X).norm();
        if (d < best)
          best = d, s = u, t = v;
      }
  }
  return best;
}

template <int D>
RigidTool<D> single(const typename RigidPiece<D>::Shape& shape)
{
  return {{RigidPiece<D>{shape}}};
}

/// The target of a particle whose slave faces it.
template <int D>
RigidTarget<D> facing(const RigidTool<D>& tool, const Vector<D>& x)
{
  for (int i = 0; i < D; ++i)
    for (double sign : {-1.0, 1.0})
      if (const auto t = tool.find(x, sign * Vector<D>::Unit(i), 10, -1, {}); t.piece >= 0)
        return tool.find(x, t.n, 10, -1, {});
  return {};
}

void require_near(const Vector<3>& a, const Vector<3>& b)
{
  CAPTURE(a.transpose(), b.transpose());
  REQUIRE((a - b).norm() <= 20 * eps);
}

} // namespace

TEST_CASE("rigid shapes: gaps and normals by hand")
{
  const Vector<3> o(0, 0, 0), z(0, 0, 1);
  // d, away from the material
  Distance<3> d = Plane<3>{{5, 5, 1}, z}.at({0.3, -7, 1.25});
  REQUIRE(d.d == 0.25);
  require_near(d.outward, z);

  d = Sphere<3>{o, 2}.at({0, 3, 0});
  REQUIRE(d.d == 1);
  require_near(d.outward, {0, 1, 0});
  REQUIRE(Sphere<3>{o, 2}.at({0, 0.5, 0}).d == -1.5); // in the material
  d = Sphere<3>{o, 2, true}.at({0, 1.5, 0});
  REQUIRE(d.d == 0.5);
  require_near(d.outward, {0, -1, 0}); // towards the slave, within
  REQUIRE(Sphere<3>{o, 2, true}.at({0, 2.5, 0}).d == -0.5);

  d = Cylinder{o, z, 2}.at({0, -3, 40});
  REQUIRE(d.d == 1);
  require_near(d.outward, {0, -1, 0});
  d = Cylinder{o, z, 2, true}.at({0, -1.5, -40});
  REQUIRE(d.d == 0.5);
  require_near(d.outward, {0, 1, 0});

  d = Torus{o, z, 3, 1}.at({5, 0, 0});
  REQUIRE(d.d == 1);
  require_near(d.outward, {1, 0, 0});
  d = Torus{o, z, 3, 1}.at({0, 3, 1.5}); // the pole of the tube
  REQUIRE(d.d == 0.5);
  require_near(d.outward, z);
  REQUIRE(Torus{o, z, 3, 1}.at({1.5, 0, 0}).d == 0.5); // in the hole
  d = Torus{o, z, 3, 1, true}.at({0, 3, 0.75});
  REQUIRE(d.d == 0.25);
  require_near(d.outward, -z);
}

TEST_CASE("rigid shapes: no target where there is no closest point, or no single one")
{
  const Vector<3> o(0, 0, 0), z(0, 0, 1);
  for (bool inside : {false, true})
  {
    REQUIRE(Sphere<3>{o, 2, inside}.at(o).d == INFINITY);
    REQUIRE(Sphere<2>{{1, 1}, 2, inside}.at({1, 1}).d == INFINITY);
    REQUIRE(Cylinder{o, z, 2, inside}.at({0, 0, 7}).d == INFINITY);
    REQUIRE(Torus{o, z, 3, 1, inside}.at({0, 0, 7}).d == INFINITY); // on its axis
    REQUIRE(Torus{o, z, 3, 1, inside}.at({0, 3, 0}).d == INFINITY); // on its circle
    const Cylinder part{o, z, 2, inside, 3};
    REQUIRE(std::isfinite(part.at({1, 1, 0}).d));
    REQUIRE(std::isfinite(part.at({1, 1, 3}).d));
    REQUIRE(part.at({1, 1, -1e-9}).d == INFINITY);
    REQUIRE(part.at({1, 1, 3 + 1e-9}).d == INFINITY);
    const RigidTool<3> sphere = single<3>(Sphere<3>{o, 2, inside});
    REQUIRE(sphere.find(o, z, 10, -1, {}).piece == -1);
  }
  const Plane<3> ring{o, z, 1, 2};
  REQUIRE(ring.at({1.5, 0, -3}).d == -3);
  REQUIRE(ring.at({0.999, 0, 0.1}).d == INFINITY);
  REQUIRE(ring.at({0, 2.001, 0.1}).d == INFINITY);
}

TEST_CASE("RigidTool: no target too far away, or for a slave that turns its back")
{
  const RigidTool<3> tool = single<3>(Sphere<3>{{0, 0, 0}, 2});
  const Vector<3> x(0, 0, 3), down(0, 0, -1);
  REQUIRE(tool.find(x, down, 1.01, -1, {}).piece == 0);
  REQUIRE(tool.find(x, down, 0.99, -1, {}).piece == -1);
  REQUIRE(tool.find(x, -down, 1.01, -1, {}).piece == -1);
  REQUIRE(tool.find({0, 0, 1.1}, down, 0.89, -1, {}).piece == -1);  // too deep
  REQUIRE(tool.find(x, Vector<3>(1, 0, 0), 10, -1, {}).piece == 0); // edgewise is facing
}

TEMPLATE_TEST_CASE_SIG("rigid shapes: the distance is that of the nearest point", "", ((int D), D),
                       2, 3)
{
  std::mt19937 random(1);
  for (const Known<D>& known : shapes<D>())
  {
    CAPTURE(known.name);
    const RigidPiece<D> piece{known.shape};
    // the parameters describe the surface
    for (double s : {0.12, 0.55, 0.93})
      REQUIRE(std::abs(piece.distance(known.point(s, 1 - s)).d) <= 20 * eps);
    int tried = 0, within = 0;
    while (tried < 20)
    {
      const Vector<D> X = uniform_vector<D>(random, -1.2, 1.2);
      const Distance<D> d = piece.distance(X);
      if (not std::isfinite(d.d))
        continue;
      ++tried;
      within += d.d < 0;
      CAPTURE(X.transpose());
      REQUIRE(std::abs(nearest(known, X) - std::abs(d.d)) <= 1e-9); // grids end at 1e-6
      REQUIRE(std::abs(piece.distance(X - d.d * d.outward).d) <= 50 * eps);
      REQUIRE(std::abs(d.outward.norm() - 1) <= 20 * eps);
    }
    CAPTURE(within);
    REQUIRE((within > 0 and within < tried)); // on both sides
  }
}

TEMPLATE_TEST_CASE_SIG("RigidTool: a particle's derivatives are those of differences", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(2);
  for (const Known<D>& known : shapes<D>())
    for (int i = 0; i < 6;)
    {
      RigidTool<D> tool = single<D>(known.shape);
      tool.pieces[0].now = random_motion<D>(random);
      tool.pieces[0].old = random_motion<D>(random);
      const Vector<D> X = uniform_vector<D>(random, -1.4, 1.4), x = tool.pieces[0].now.to(X);
      const RigidTarget<D> t = facing(tool, x);
      if (t.piece < 0 or tool.pieces[0].distance(X).turning.norm() > 10) // centres
        continue;
      ToolPair<D> pair(tool, x, t.n, random);
      if (not pair.regular())
        continue;
      CAPTURE(known.name, X.transpose(), t.gap);
      pair.check();
      // x¹ − x² is along n
      const Vector<D> r = x - tool.point(0, t.target, x);
      REQUIRE((r - t.gap * t.n).norm() <= 50 * eps);
      ++i;
    }
}

TEMPLATE_TEST_CASE_SIG("RigidTool: no slip if the particle moves with the tool", "", ((int D), D),
                       2, 3)
{
  std::mt19937 random(4);
  for (const Known<D>& known : shapes<D>())
  {
    RigidTool<D> tool = single<D>(known.shape);
    tool.pieces[0].now = random_motion<D>(random);
    tool.pieces[0].old = random_motion<D>(random);
    const auto& [shape, now, old] = tool.pieces[0];
    const Vector<D> X = uniform_vector<D>(random, -1, 1), slide = uniform_vector<D>(random, -1, 1),
                    x = now.R * X + now.c, x_old = old.R * X + old.c;
    REQUIRE(tool.slip(0, x, x_old).norm() <= 20 * eps);
    REQUIRE((tool.slip(0, x + slide, x_old) - slide).norm() <= 20 * eps);
    // the gap is that in the tool's frame
    const Distance<D> d = tool.pieces[0].distance(X);
    if (std::isfinite(d.d))
      REQUIRE(tool.linearise(0, {}, x, x_old).gap == Approx(-d.d).margin(20 * eps));
  }
}

TEST_CASE("RigidTool: a die of a ring, its corner and its wall")
{
  // corner of radius 0.3 around r = 1: a ring beyond 1, a tube, a hole of radius 0.7
  const Vector<3> z(0, 0, 1);
  const double ring = 1, radius = 0.3;
  RigidTool<3> die{{RigidPiece<3>{Plane<3>{{0, 0, 0}, z, ring, 3}},
                    RigidPiece<3>{Torus{-radius * z, z, ring, radius}},
                    RigidPiece<3>{Cylinder{-2 * z, z, ring - radius, true, 2 - radius}}}};
  std::mt19937 random(6);
  const RigidMotion<3> motion = random_motion<3>(random);
  for (RigidPiece<3>& p : die.pieces)
    p.now = p.old = motion;

  // along the profile, outside and inside of the material
  for (double offset : {0.05, -0.02, 1e-6, -1e-6})
  {
    Vector<3> last = motion.R * -z;
    double s = 0, farthest = 0;
    std::array<int, 3> on{};
    const double corner = radius * M_PI / 2;
    for (; s < 0.5 + corner + 0.5; s += 1e-3)
    {
      Eigen::Vector2d p, n; // (r, z) on the profile, and outward
      int expected;
      if (s < 0.5)
      {
        p << 1.5 - s, 0;
        n << 0, 1;
        expected = 0;
      }
      else if (s < 0.5 + corner)
      {
        const double a = (s - 0.5) / radius;
        n << -sin(a), cos(a);
        p = Eigen::Vector2d(ring, -radius) + radius * n;
        expected = 1;
      }
      else
      {
        p << ring - radius, -radius - (s - 0.5 - corner);
        n << -1, 0;
        expected = 2;
      }
      const Eigen::Vector2d q = p + offset * n;
      const double angle = 3 * s;
      const Vector<3> e(cos(angle), sin(angle), 0);
      const Vector<3> x = motion.to(q[0] * e + q[1] * z),
                      outward = motion.R * (n[0] * e + n[1] * z);
      const RigidTarget<3> t = die.find(x, -outward, 10, -1, {});
      CAPTURE(s, offset);
      const bool junction = std::abs(s - 0.5) < 2e-3 or std::abs(s - 0.5 - corner) < 2e-3;
      if (not junction)
        REQUIRE(t.piece == expected);
      REQUIRE(t.piece >= 0);
      ++on[t.piece];
      REQUIRE(t.gap == Approx(-offset).margin(1e-14));
      REQUIRE((t.n + outward).norm() <= 1e-12);
      REQUIRE((die.point(t.piece, t.target, x) - motion.to(p[0] * e + p[1] * z)).norm() <= 1e-14);
      farthest = std::max(farthest, (t.n - last).norm());
      last = t.n;
    }
    // the normal does not jump where pieces meet: it turns by ds/radius, and by the angle about z
    REQUIRE(farthest <= 1.05e-3 * (1 / radius + 3));
    REQUIRE((on[0] > 400 and on[1] > 400 and on[2] > 400));
  }

  // derivatives near the edges too
  for (double r : {1.02, 0.98, 0.72, 0.701})
    for (int i = 0; i < 4; ++i)
    {
      const double a = uniform(random, 0, 6), h = r > 0.75 ? 0.03 : -0.28;
      const Vector<3> x = motion.to({r * cos(a), r * sin(a), h});
      const RigidTarget<3> t = facing(die, x);
      REQUIRE(t.piece >= 0);
      ToolPair<3> pair(die, x, t.n, random);
      CAPTURE(r, t.piece);
      REQUIRE(pair.regular());
      pair.check();
    }
}

TEMPLATE_TEST_CASE_SIG("RigidTool: pieces with motions of their own; the nearest counts", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(7);
  int chosen[2] = {};
  for (int i = 0; i < 40; ++i)
  {
    // two circles (spheres) near each other; a third far away
    RigidTool<D> tool;
    for (double at : {0.0, 1.2, 50.0})
    {
      RigidPiece<D> p{Sphere<D>{uniform_vector<D>(random, -0.1, 0.1), 0.7}};
      p.now = {random_rotation<D>(random), at * Vector<D>::Unit(0)};
      p.old = random_motion<D>(random);
      tool.pieces.push_back(p);
    }
    const Vector<D> x = uniform_vector<D>(random, -0.8, 0.8) + 0.6 * Vector<D>::Unit(0);
    std::array<double, 2> gap;
    for (int k = 0; k < 2; ++k)
    {
      const auto& s = std::get<Sphere<D>>(tool.pieces[k].shape);
      gap[k] = s.radius - (x - tool.pieces[k].now.to(s.center)).norm();
    }
    const int deeper = gap[0] > gap[1] ? 0 : 1;
    const auto& s = std::get<Sphere<D>>(tool.pieces[deeper].shape);
    const Vector<D> n = (tool.pieces[deeper].now.to(s.center) - x).normalized();
    const RigidTarget<D> t = tool.find(x, n, 10, -1, {});
    REQUIRE(t.piece == deeper);
    REQUIRE(t.gap == Approx(gap[deeper]));
    REQUIRE((t.n - n).norm() <= 50 * eps);
    ++chosen[deeper];
    ToolPair<D> pair(tool, x, n, random);
    if (pair.regular()
        and tool.pieces[deeper].distance(tool.pieces[deeper].now.back(x)).turning.norm() < 10)
      pair.check();
  }
  REQUIRE((chosen[0] > 5 and chosen[1] > 5));
}
