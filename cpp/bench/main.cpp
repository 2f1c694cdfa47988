// SPDX-License-Identifier: MIT
//
// One main for all C++ benchmarks. It prints one line a benchmark: the least CPU time of the
// repetitions for one particle (or facet), and by how much the slowest repetition exceeds it. A
// family of growing sizes ends with the exponent q of time ∝ size^q. Google Benchmark's flags work;
// raw figures go to a file with --benchmark_out.
#include <algorithm>
#include <benchmark/benchmark.h>
#include <cmath>
#include <cstdio>
#include <map>
#include <petscsys.h>
#include <vector>

namespace
{

class Table : public benchmark::BenchmarkReporter
{
public:
  bool ReportContext(const Context& context) override
  {
    const benchmark::CPUInfo& cpu = context.cpu_info;
    char petsc[256];
    PetscGetVersion(petsc, sizeof(petsc));
    std::printf("%d CPUs of %.0f MHz, load %.1f; %.28s; compiler %s\n\n", cpu.num_cpus,
                cpu.cycles_per_second / 1e6, cpu.load_avg.empty() ? 0.0 : cpu.load_avg[0], petsc,
                __VERSION__);
    std::printf("%-52s %9s\n", "", "CPU, us");
    return true;
  }

  void ReportRuns(const std::vector<Run>& runs) override
  {
    std::map<std::string, std::vector<double>> times; // counter -> seconds of each repetition
    for (const Run& run : runs)
    {
      if (run.error_occurred)
        std::printf("%-52s %s\n", run.run_name.function_name.c_str(), run.error_message.c_str());
      else if (run.report_big_o)
        print_growth(run.run_name.function_name);
      else if (run.run_type == Run::RT_Iteration)
      {
        for (const auto& [what, counter] : run.counters)
          times[what].push_back(counter.value);
        if (run.complexity_n > 0)
          _growth[run.complexity_n].push_back(run.cpu_accumulated_time / run.iterations);
      }
    }
    for (const auto& [what, t] : times)
    {
      const auto [least, most] = std::minmax_element(t.begin(), t.end());
      const benchmark::BenchmarkName& run = runs.front().run_name;
      const std::string name = run.function_name + (run.args.empty() ? "" : "/" + run.args);
      std::printf("%-52s %9.3f  %-12s + %.0f %%\n", name.c_str(), 1e6 * *least, what.c_str(),
                  100 * (*most / *least - 1));
    }
    std::fflush(stdout);
  }

private:
  // Slope of log(least time) over log(size) by least squares.
  void print_growth(const std::string& name)
  {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const auto& [size, times] : _growth)
    {
      const double a = std::log(double(size)),
                   b = std::log(*std::min_element(times.begin(), times.end()));
      n += 1, x += a, y += b, xx += a * a, xy += a * b;
    }
    std::printf("%-52s %9.2f  %s\n", (name + ": growth").c_str(),
                (n * xy - x * y) / (n * xx - x * x), "exponent of the number of facets");
    _growth.clear();
  }

  std::map<std::int64_t, std::vector<double>> _growth; // size -> time of a whole iteration
};

} // namespace

int main(int argc, char** argv)
{
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv))
    return 1;
  if (PetscInitializeNoArguments() != 0)
    return 1;
  Table table;
  benchmark::RunSpecifiedBenchmarks(&table);
  benchmark::ClearRegisteredBenchmarks(); // and what they hold of PETSc
  benchmark::Shutdown();
  PetscFinalize();
}
