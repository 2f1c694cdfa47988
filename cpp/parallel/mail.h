// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <mpi.h>
#include <numeric>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace dolfinx_contact
{

/// Bytes received from other ranks since the program began.
inline std::int64_t bytes_in = 0;

inline int comm_rank(MPI_Comm comm)
{
  int rank;
  MPI_Comm_rank(comm, &rank);
  return rank;
}

inline int comm_size(MPI_Comm comm)
{
  int size;
  MPI_Comm_size(comm, &size);
  return size;
}

/// Throw on all ranks if one has an `error`. A rank that threw alone would leave the others waiting
/// in their next collective call.
inline void throw_together(MPI_Comm comm, const std::string& error)
{
  const int size = comm_size(comm);
  int first = error.empty() ? size : comm_rank(comm);
  MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, comm);
  bytes_in += size > 1 ? sizeof(int) : 0;
  if (first == size)
    return;
  throw std::invalid_argument(
      error.empty() ? "the exchange of contact facets failed: see the message of rank "
                          + std::to_string(first)
                    : error);
}

/// What arrived from all ranks: rank r sent data[offset[r]..offset[r + 1]).
template <typename T>
struct Mail
{
  std::vector<T> data;
  std::vector<int> offset; // (ranks + 1)

  std::span<const T> from(int r) const
  {
    return std::span(data).subspan(offset[r], offset[r + 1] - offset[r]);
  }
};

/// Collective: send out[r] to rank r, for all r (this rank too).
template <typename T>
Mail<T> all_to_all(MPI_Comm comm, const std::vector<std::vector<T>>& out)
{
  static_assert(std::is_same_v<T, double> or std::is_same_v<T, std::int64_t>);
  const MPI_Datatype type = std::is_same_v<T, double> ? MPI_DOUBLE : MPI_INT64_T;

  // Counted in 64 bits until all ranks know that MPI's int will do
  const std::size_t size = out.size();
  std::vector<std::int64_t> send(size), receive(size);
  std::transform(out.begin(), out.end(), send.begin(), [](auto& v) { return std::ssize(v); });
  MPI_Alltoall(send.data(), 1, MPI_INT64_T, receive.data(), 1, MPI_INT64_T, comm);
  const auto elsewhere = std::reduce(receive.begin(), receive.end()) - receive[comm_rank(comm)];
  bytes_in += sizeof(std::int64_t) * (size - 1) + sizeof(T) * elsewhere;
  const std::int64_t total = std::max(std::reduce(send.begin(), send.end()),
                                      std::reduce(receive.begin(), receive.end()));
  throw_together(comm, total <= std::numeric_limits<int>::max()
                           ? ""
                           : "one rank would exchange " + std::to_string(total)
                                 + " numbers of contact facets, MPI can count 2147483647: use more "
                                   "ranks or a smaller search radius");

  const std::vector<int> send_counts(send.begin(), send.end());
  const std::vector<int> receive_counts(receive.begin(), receive.end());
  std::vector<int> send_offset(size + 1, 0);
  std::partial_sum(send_counts.begin(), send_counts.end(), send_offset.begin() + 1);
  Mail<T> mail;
  mail.offset.assign(size + 1, 0);
  std::partial_sum(receive_counts.begin(), receive_counts.end(), mail.offset.begin() + 1);

  std::vector<T> flat;
  flat.reserve(send_offset.back());
  for (const std::vector<T>& v : out)
    flat.insert(flat.end(), v.begin(), v.end());
  mail.data.resize(mail.offset.back());
  MPI_Alltoallv(flat.data(), send_counts.data(), send_offset.data(), type, mail.data.data(),
                receive_counts.data(), mail.offset.data(), type, comm);
  return mail;
}

} // namespace dolfinx_contact
