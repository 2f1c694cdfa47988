// SPDX-License-Identifier: MIT
#include "watchdog.h"

#include <chrono>
#include <condition_variable>
#include <mpi.h>
#include <mutex>
#include <optional>
#include <pthread.h>
#include <signal.h>
#include <thread>
#include <unistd.h>

namespace dolfinx_contact
{
namespace
{
using Clock = std::chrono::steady_clock;

struct Watched
{
  Clock::time_point end;
  std::string text;
  pthread_t thread;
  int signal, file;
  std::chrono::duration<double> grace;
};

// never destroyed: the thread still waits for them as the process ends
std::mutex& mutex = *new std::mutex;
std::condition_variable& changed = *new std::condition_variable;
std::optional<Watched>& watched = *new std::optional<Watched>; // guarded by the mutex

void say(const std::string& text)
{
  // write, not iostreams: another thread may hold their locks
  for (std::size_t done = 0; done < text.size();)
  {
    const ssize_t n = ::write(STDERR_FILENO, text.data() + done, text.size() - done);
    if (n <= 0)
      return;
    done += static_cast<std::size_t>(n);
  }
}

std::string content(int file)
{
  std::string out;
  char buffer[4096];
  for (ssize_t n; file >= 0 and (n = ::pread(file, buffer, sizeof(buffer), std::ssize(out))) > 0;)
    out.append(buffer, static_cast<std::size_t>(n));
  return out;
}

[[noreturn]] void end_job(const Watched& w)
{
  pthread_kill(w.thread, w.signal);
  std::this_thread::sleep_for(std::chrono::milliseconds(500)); // its handler takes less
  say(w.text + content(w.file));
  std::this_thread::sleep_for(w.grace);
  // should MPI wait for a lock of the thread that hangs, this ends the process all the same
  std::thread(
      []
      {
        std::this_thread::sleep_for(std::chrono::seconds(5));
        _exit(1);
      })
      .detach();
  int initialized = 0, finalized = 0;
  MPI_Initialized(&initialized);
  MPI_Finalized(&finalized);
  if (initialized and not finalized)
    MPI_Abort(MPI_COMM_WORLD, 1);
  _exit(1);
}

void run()
{
  std::unique_lock lock(mutex);
  while (true)
  {
    changed.wait(lock, [] { return watched.has_value(); });
    const Clock::time_point end = watched->end;
    if (Clock::now() >= end)
      end_job(*watched);
    changed.wait_until(lock, end, [end] { return not watched or watched->end != end; });
  }
}
} // namespace

void watch(double seconds, const std::string& text, int signal, int file, double grace)
{
  const std::lock_guard lock(mutex);
  if (seconds > 0)
  {
    static const bool started = (std::thread(run).detach(), true);
    static_cast<void>(started);
    const auto time
        = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
    watched = Watched{Clock::now() + time,
                      text,
                      pthread_self(),
                      signal,
                      file,
                      std::chrono::duration<double>(grace)};
  }
  else
    watched.reset();
  changed.notify_one();
}
} // namespace dolfinx_contact
