// SPDX-License-Identifier: MIT
//
// That a job does end, and what it says, is tested from outside (tests/test_faults.py).
#include "../parallel/watchdog.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <thread>

using namespace dolfinx_contact;

TEST_CASE("a watch that is renewed or ended in time ends nothing", "[watchdog]")
{
  const std::chrono::milliseconds longer(1300);
  watch(1.0, "test_watchdog: not renewed\n", SIGTERM, -1, 0.0);
  watch(100.0, "test_watchdog: not ended\n", SIGTERM, -1, 0.0);
  std::this_thread::sleep_for(longer);
  watch(1.0, "test_watchdog: not ended\n", SIGTERM, -1, 0.0);
  watch(0.0, "", SIGTERM, -1, 0.0);
  watch(0.0, "", SIGTERM, -1, 0.0); // there is none to end
  std::this_thread::sleep_for(longer);
  SUCCEED("still here");
}
