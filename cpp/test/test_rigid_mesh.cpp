// SPDX-License-Identifier: MIT
//
// Rigid tools given by a mesh: the same as a deformable master that is moved rigidly.
#include "tool_pair.h"

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr double crease = 2; // angle

struct Variant
{
  TargetRule target;
  NormalRule normal;
};
constexpr std::array variants = {Variant{TargetRule::smooth, NormalRule::interpolated},
                                 Variant{TargetRule::proximity, NormalRule::interpolated},
                                 Variant{TargetRule::proximity, NormalRule::facet}};

template <int D>
std::vector<Shape> facet_shapes()
{
  if (D == 2)
    return {Shape::interval};
  return {Shape::triangle, Shape::quadrilateral};
}

/// A wavy plate with the material below.
template <int D>
Surface wave(Shape shape)
{
  return plate<D>(Element{shape, 1, 1}, 4, 1,
                  [](const Eigen::Vector3d& p)
                  {
                    Vector<D> x = p.head<D>();
                    x[D - 1] = 0.1 * std::sin(4 * p[0] + 0.3);
                    if (D == 3)
                      x[D - 1] += 0.08 * std::cos(3 * p[1]);
                    return x;
                  });
}

template <int D>
SearchOptions<D> far()
{
  SearchOptions<D> o;
  o.radius = 10;
  return o;
}

template <int D>
RigidTool<D> tool_of(const Surface& s, const Variant& v)
{
  const Rules rules{v.target, v.normal, false};
  return {{RigidPiece<D>{std::make_shared<const RigidMesh<D>>(s, rules, far<D>(), crease)}}};
}

/// The regular polygon of n sides around the origin, its corners on the unit circle.
Surface polygon(int n)
{
  std::mt19937 random(1);
  return build<2>(
      Element{Shape::interval, 1, 1}.ref(), line_cells(n),
      [n](const Eigen::Vector3d& p)
      {
        const double a = 2 * M_PI * std::fmod(std::round(p[0] * n), n) / n;
        return Vector<2>(std::cos(a), std::sin(a));
      },
      [](const Vector<2>& x) { return Vector<2>(-x); }, random);
}

} // namespace

TEST_CASE("RigidMesh: a square by hand")
{
  const RigidTool<2> tool = tool_of<2>(polygon(4), variants[2]);
  const double side = std::sqrt(0.5); // distance of the sides from the middle
  const Vector<2> out = Vector<2>(1, 1).normalized();
  for (double d : {0.3, -0.2})
  {
    const Vector<2> x = (side + d) * out;
    const RigidTarget<2> t = tool.find(x, -out, 10, -1, {});
    REQUIRE(t.piece == 0);
    REQUIRE(t.gap == Approx(-d));
    REQUIRE((t.n + out).norm() <= 50 * eps);
    REQUIRE((tool.point(0, t.target, x) - side * out).norm() <= 50 * eps);
    REQUIRE(tool.find(x, out, 0.5, -1, {}).piece == -1); // only the far side faces it
  }
  // beyond a corner: the closest point is the corner, the gap along the facet's normal
  const Vector<2> x(1.2, 0.01);
  const RigidTarget<2> t = tool.find(x, Vector<2>(-1, 0), 10, -1, {});
  REQUIRE((tool.point(0, t.target, x) - Vector<2>(1, 0)).norm() <= 1e-12);
}

TEST_CASE("RigidMesh: smooth targets on a polygon have the normals of a circle")
{
  const RigidTool<2> tool = tool_of<2>(polygon(24), variants[0]);
  std::mt19937 random(3);
  for (int i = 0; i < 50; ++i)
  {
    const double a = uniform(random, 0, 6.28), r = uniform(random, 0.9, 1.2);
    const Vector<2> e(std::cos(a), std::sin(a));
    const RigidTarget<2> t = tool.find(r * e, -e, 10, -1, {});
    REQUIRE(t.piece == 0);
    const double h = 2 * M_PI / 24;
    REQUIRE((t.n + e).norm() <= h * h * h / 12);          // third order
    REQUIRE(std::abs(t.gap + r - 1) <= 1.05 * h * h / 8); // the sagitta
  }
}

TEMPLATE_TEST_CASE_SIG("RigidMesh: what a deformable master is that moves rigidly", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(4);
  for (Shape shape : facet_shapes<D>())
    for (const Variant& v : variants)
    {
      const Surface reference = wave<D>(shape);
      RigidTool<D> tool = tool_of<D>(reference, v);
      const RigidMotion<D> motion = random_motion<D>(random);
      tool.pieces[0].now = motion;

      Surface moved = reference;
      std::vector<double> u(moved.node_table.size() * D);
      for (int f = 0; f < moved.size(); ++f)
        for (int a = 0; a < moved.nu(); ++a)
        {
          const Vector<D> X = Eigen::Map<const Vector<D>>(moved.facet_X(f) + a * D),
                          by = motion.to(X) - X;
          std::copy_n(by.data(), D, u.begin() + moved.local[f * moved.nu() + a] * D);
        }
      moved.displace(u);
      SearchOptions<D> options = far<D>();
      options.rule = v.target;
      const bool smooth = v.normal == NormalRule::interpolated;
      options.margin = smooth ? 0 : options.margin;
      Search<D> search(moved, options);
      NodalNormals<D> normals;
      if (smooth)
      {
        normals = NodalNormals<D>(moved, crease);
        normals.update(moved);
      }
      int free = 0, clamped = 0;
      for (int i = 0; i < 60; ++i)
      {
        Vector<D> X = uniform_vector<D>(random, -0.1, 1.1); // beyond the ends, too
        X[D - 1] = uniform(random, -0.1, 0.25);
        const Vector<D> x = motion.to(X), down = -motion.R.col(D - 1);
        const RigidTarget<D> t = tool.find(x, down, 10, -1, {});
        const Target<D> expected = search.find(moved, {x, down}, {}, smooth ? &normals : nullptr);
        REQUIRE(t.target.facet == expected.facet);
        REQUIRE((t.piece == 0) == (expected.facet >= 0));
        if (t.piece < 0)
          continue;
        REQUIRE((t.target.xi - expected.xi).norm() <= 1e-9);
        REQUIRE(t.target.clamp == expected.clamp);
        (expected.clamp == Clamp::none ? free : clamped)++;
        NormalField<D> field;
        if (smooth)
          field = normals.at(moved, expected.facet, expected.xi.data());
        const FacetPoint<D> p = FacetProjection<D>(moved, expected.facet).at(expected.xi, true);
        const Kinematics<D> k = linearise<D>(moved, expected, x, p, {v.target, v.normal, false},
                                             Vector<D>::Zero(), &field),
                            own = tool.linearise(0, t.target, x, x);
        REQUIRE((tool.point(0, t.target, x) - p.x).norm() <= 1e-9);
        REQUIRE(t.gap == Approx(k.gap).margin(1e-9));
        REQUIRE((t.n - k.n).norm() <= 1e-9);
        REQUIRE((own.r - k.r).norm() <= 1e-9);
        REQUIRE((own.z.gap.template head<D>() - k.z.gap.template head<D>()).norm() <= 1e-8);
        REQUIRE((own.z.n.template leftCols<D>() - k.z.n.template leftCols<D>()).norm() <= 1e-7);
      }
      REQUIRE((free > 20 and clamped > 2));
    }
}

TEMPLATE_TEST_CASE_SIG("RigidMesh: a particle's derivatives are those of differences", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(5);
  for (Shape shape : facet_shapes<D>())
    for (const Variant& v : variants)
    {
      CAPTURE(D, static_cast<int>(shape), static_cast<int>(v.target), static_cast<int>(v.normal));
      RigidTool<D> tool = tool_of<D>(wave<D>(shape), v);
      int free = 0, clamped = 0, within = 0, outside = 0;
      for (int i = 0; i < 400 and (free < 8 or clamped < 2); ++i)
      {
        tool.pieces[0].now = random_motion<D>(random);
        tool.pieces[0].old = random_motion<D>(random);
        const RigidMotion<D>& now = tool.pieces[0].now;
        Vector<D> X = uniform_vector<D>(random, -0.1, 1.1);
        X[D - 1] = uniform(random, -0.2, 0.2);
        const Vector<D> x = now.to(X), down = -now.R.col(D - 1);
        const RigidTarget<D> t = tool.find(x, down, 10, -1, {});
        if (t.piece < 0)
          continue;
        ToolPair<D> pair(tool, x, down, random);
        if (not pair.regular())
          continue;
        CAPTURE(X.transpose(), t.target.facet, static_cast<int>(t.target.clamp));
        pair.check();
        (t.target.clamp == Clamp::none ? free : clamped)++;
        (t.gap > 0 ? within : outside)++;
      }
      REQUIRE((free >= 8 and clamped >= 2 and within > 1 and outside > 1));
    }
}

TEST_CASE("RigidMesh: former targets do not hinder the motion of the tool")
{
  // the tool slides by several facets under a particle that stays
  const Surface s = wave<2>(Shape::interval);
  RigidTool<2> tool = tool_of<2>(s, variants[0]);
  RigidTarget<2> former;
  std::vector<int> facets;
  for (double c = 0.4; c > -0.4; c -= 0.02)
  {
    tool.pieces[0].now.c = Vector<2>(c, 0);
    const Vector<2> x(0.5, 0.15), down(0, -1);
    former = tool.find(x, down, 10, former.piece, former.target);
    const RigidTarget<2> fresh = tool.find(x, down, 10, -1, {});
    REQUIRE(former.target.facet == fresh.target.facet);
    REQUIRE(former.gap == Approx(fresh.gap).margin(1e-12));
    if (facets.empty() or facets.back() != former.target.facet)
      facets.push_back(former.target.facet);
  }
  REQUIRE(facets.size() == 4);
}
