// SPDX-License-Identifier: MIT
#include "j2_plasticity.h"

#include <Eigen/Dense>
#include <array>
#include <stdexcept>

namespace dolfinx_contact
{
namespace
{
using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;

// Rows and columns of the K components of F
template <int K>
constexpr std::array<std::array<int, 2>, K> components()
{
  if constexpr (K == 4)
    return {{{0, 0}, {0, 1}, {1, 0}, {1, 1}}};
  else if constexpr (K == 5)
    return {{{0, 0}, {0, 1}, {1, 0}, {1, 1}, {2, 2}}};
  else
    return {{{0, 0}, {0, 1}, {0, 2}, {1, 0}, {1, 1}, {1, 2}, {2, 0}, {2, 1}, {2, 2}}};
}

template <int K>
Matrix3 embed(const double* F)
{
  Matrix3 out = Matrix3::Identity();
  for (int c = 0; c < K; ++c)
    out(components<K>()[c][0], components<K>()[c][1]) = F[c];
  return out;
}

Matrix3 symmetric(const double* s)
{
  return (Matrix3() << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2]).finished();
}

void store(const Matrix3& m, double* s)
{
  s[0] = m(0, 0), s[1] = m(1, 1), s[2] = m(2, 2), s[3] = m(0, 1), s[4] = m(1, 2), s[5] = m(0, 2);
}

// atanh(z)/z, |z| < 1
double atanh_ratio(double z)
{
  const double y = z * z;
  if (y > 2e-3)
    return std::atanh(z) / z;
  // the next term is below 1e-17
  return 1 + y * (1. / 3 + y * (1. / 5 + y * (1. / 7 + y * (1. / 9 + y * (1. / 11)))));
}

// Logarithmic trial strains in their principal axes.
struct Trial
{
  Vector3 d;     // b_a − 1
  Matrix3 n;     // axes, by columns
  Vector3 e;     // deviatoric strains
  double volume; // tr ε

  double q(double mu) const { return std::sqrt(6.0) * mu * e.norm(); }
};

// Returns whether F is finite and det F > 0.
bool trial(const Matrix3& F, const Matrix3& cp, Trial& t)
{
  const double det = F.determinant();
  if (not std::isfinite(det) or not(det > 0))
    return false;
  // b − I and not b, so that small strains keep their digits
  const Matrix3 H = F - Matrix3::Identity();
  const Matrix3 d
      = H + H.transpose() + H * H.transpose() + F * (cp - Matrix3::Identity()) * F.transpose();
  if (not d.allFinite())
    return false;
  // iterative: the closed form loses half the digits where eigenvalues are close
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(d);
  t.d = solver.eigenvalues();
  t.n = solver.eigenvectors();
  if (not(t.d[0] > -1)) // b is positive, but for round-off
    return false;
  t.e = 0.5 * t.d.unaryExpr([](double x) { return std::log1p(x); });
  t.volume = t.e.sum();
  t.e.array() -= t.volume / 3;
  return true;
}

// A of one point, from δF = l F:
//
//     δP = (δτ − τ lᵀ) F⁻ᵀ,   δτ_aa = Σ_c D_ac l_cc,   δτ_ab = θ_ab (l_ab b_b + b_a l_ba)     (4)
//
// in the principal axes, with D = ∂τ_a/∂ε_c of the return (1), (2) and
//
//     θ_ab = (τ_a − τ_b)/(b_a − b_b) = 2μr atanh(z)/z/(b_a + b_b),   z = (b_a − b_b)/(b_a + b_b),
//
// which has no 0/0. With the dyads T_ab = n_a ⊗ m_b, m_b = F⁻¹ n_b, A is Σ M_abcd T_ab ⊗ T_cd.
template <int K>
Eigen::Matrix<double, K, K, Eigen::RowMajor> tangent(const Elasticity& el, const Trial& t,
                                                     const Flow& f, double q, double r,
                                                     const Vector3& tau, const Matrix3& m)
{
  const double mu = el.mu;
  Eigen::Matrix<double, K, 9> T, TM; // columns 00, 11, 22, 01, 10, 12, 21, 20, 02
  constexpr std::array<int, 9> A = {0, 1, 2, 0, 1, 1, 2, 2, 0}, B = {0, 1, 2, 1, 0, 2, 1, 0, 2};
  for (int c = 0; c < 9; ++c)
    for (int i = 0; i < K; ++i)
      T(i, c) = t.n(components<K>()[i][0], A[c]) * m(components<K>()[i][1], B[c]);

  Matrix3 D = Matrix3::Constant(el.lambda + 2 * mu / 3 * (1 - r));
  D.diagonal().array() += 2 * mu * r;
  if (q > 0)
  {
    const Vector3 N = t.e.normalized();
    D += 6 * mu * mu * (f.amount / q - 1 / (3 * mu + f.slope)) * N * N.transpose();
  }
  D.diagonal() -= tau;
  TM.template leftCols<3>() = T.template leftCols<3>().lazyProduct(D);
  for (int c = 3; c < 9; c += 2)
  {
    const int a = A[c], b = B[c];
    const double sum = 2 + t.d[a] + t.d[b];
    const double theta = 2 * mu * r * atanh_ratio((t.d[a] - t.d[b]) / sum) / sum;
    // of l_ab in the row of δτ_ab, of l_ba in that of δτ_ba; and crosswise, where τ_a − τ_b =
    // θ (b_a − b_b) makes both equal
    const double ab = theta * (1 + t.d[b]), ba = theta * (1 + t.d[a]), cross = ba - tau[a];
    TM.col(c) = ab * T.col(c) + cross * T.col(c + 1);
    TM.col(c + 1) = ba * T.col(c + 1) + cross * T.col(c);
  }
  return TM.lazyProduct(T.transpose());
}

// One step of all points. solve(i, q) gives the flow of point i.
template <int K, typename Solve>
int update_points(const Elasticity& el, std::span<const double> F,
                  const PlasticState<const double>& old, const PlasticResponse& out, Solve&& solve)
{
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  int bad = 0;
  for (std::size_t i = 0; i < old.ep.size(); ++i)
  {
    const Matrix3 Fi = embed<K>(&F[K * i]);
    Trial t;
    if (not trial(Fi, symmetric(&old.cp[6 * i]), t))
    {
      ++bad;
      std::copy_n(&old.cp[6 * i], 6, &out.state.cp[6 * i]);
      out.state.ep[i] = old.ep[i];
      std::fill_n(&out.tau[6 * i], 6, nan);
      std::fill_n(&out.P[K * i], K, nan);
      std::fill_n(&out.A[K * K * i], K * K, nan);
      continue;
    }
    const double q = t.q(el.mu);
    const Flow f = solve(i, q);
    const double r = f.amount > 0 ? 1 - 3 * el.mu * f.amount / q : 1;
    const Matrix3 m = Fi.inverse() * t.n;
    const Vector3 tau
        = ((el.lambda + 2 * el.mu / 3) * t.volume + 2 * el.mu * r * t.e.array()).matrix();

    const Matrix3 n_tau = t.n * tau.asDiagonal();
    const Matrix3 P = n_tau * m.transpose();
    for (int c = 0; c < K; ++c)
      out.P[K * i + c] = P(components<K>()[c][0], components<K>()[c][1]);
    store(n_tau * t.n.transpose(), &out.tau[6 * i]);
    Eigen::Map<Eigen::Matrix<double, K, K, Eigen::RowMajor>>(&out.A[K * K * i])
        = tangent<K>(el, t, f, q, r, tau, m);

    out.state.ep[i] = old.ep[i] + f.amount;
    if (f.amount > 0)
    {
      const Vector3 stretch = (2 * (t.volume / 3 + r * t.e.array())).exp();
      store(m * stretch.asDiagonal() * m.transpose(), &out.state.cp[6 * i]);
    }
    else
      std::copy_n(&old.cp[6 * i], 6, &out.state.cp[6 * i]);
  }
  return bad;
}

// Calls a function object with k as a compile-time constant.
template <typename Run>
auto with_size(int k, Run&& run)
{
  switch (k)
  {
  case 4:
    return run(std::integral_constant<int, 4>());
  case 5:
    return run(std::integral_constant<int, 5>());
  case 9:
    return run(std::integral_constant<int, 9>());
  default:
    throw std::invalid_argument("plasticity: points have 4, 5 or 9 components of F");
  }
}

void check(bool fits)
{
  if (not fits)
    throw std::invalid_argument("plasticity: the arrays do not have the same number of points");
}

void check_sizes(std::size_t k, std::span<const double> F, const PlasticState<const double>& old,
                 const PlasticResponse& out)
{
  const std::size_t n = old.ep.size();
  check(F.size() == n * k and old.cp.size() == 6 * n and out.state.cp.size() == 6 * n
        and out.state.ep.size() == n and out.tau.size() == 6 * n and out.P.size() == n * k
        and out.A.size() == n * k * k);
}

} // namespace

int update(const Elasticity& elasticity, const Hardening& hardening, int k,
           std::span<const double> F, const PlasticState<const double>& old,
           const PlasticResponse& out)
{
  check_sizes(k, F, old, out);
  return std::visit(
      [&](const auto& law)
      {
        auto solve
            = [&](std::size_t i, double q) { return flow(law, elasticity.mu, q, old.ep[i]); };
        return with_size(k, [&](auto K)
                         { return update_points<K()>(elasticity, F, old, out, solve); });
      },
      hardening);
}

int update_given(const Elasticity& elasticity, std::span<const double> flow, int k,
                 std::span<const double> F, const PlasticState<const double>& old,
                 const PlasticResponse& out)
{
  check_sizes(k, F, old, out);
  check(flow.size() == 2 * old.ep.size());
  auto solve = [&](std::size_t i, double) { return Flow{flow[2 * i], flow[2 * i + 1]}; };
  return with_size(k, [&](auto K) { return update_points<K()>(elasticity, F, old, out, solve); });
}

void trial_stress(const Elasticity& elasticity, int k, std::span<const double> F,
                  std::span<const double> cp, std::span<double> q)
{
  check(F.size() == q.size() * k and cp.size() == 6 * q.size());
  with_size(k,
            [&](auto K)
            {
              for (std::size_t i = 0; i < q.size(); ++i)
              {
                Trial t;
                const bool good = trial(embed<K()>(&F[K() * i]), symmetric(&cp[6 * i]), t);
                q[i] = good ? t.q(elasticity.mu) : std::numeric_limits<double>::quiet_NaN();
              }
            });
}

} // namespace dolfinx_contact
