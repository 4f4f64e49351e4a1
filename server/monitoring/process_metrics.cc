#include "server/monitoring/process_metrics.h"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <sstream>
#include <string>
#include <system_error>

namespace maneuver::monitoring {
namespace {

std::string Read(const char* file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// Returns when the machine was started, Unix time.
std::optional<double> BootTime() {
  static const std::optional<double> boot_time = []() -> std::optional<double> {
    std::istringstream lines(Read("/proc/stat"));
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with("btime ")) return std::stod(line.substr(6));
    }
    return std::nullopt;
  }();
  return boot_time;
}

// Reads /proc/[pid]/stat, proc(5). Fields are counted from 1. The second one is the program's name
// in brackets, which may contain anything.
std::optional<ProcessMetrics> ReadStat() {
  const std::string stat = Read("/proc/self/stat");
  const size_t name_end = stat.rfind(')');
  if (name_end == std::string::npos) return std::nullopt;
  std::istringstream fields(stat.substr(name_end + 1));
  constexpr int kUserTime = 14, kSystemTime = 15, kStart = 22, kVirtual = 23, kResident = 24;
  const double ticks = static_cast<double>(sysconf(_SC_CLK_TCK));
  const double page = static_cast<double>(sysconf(_SC_PAGESIZE));
  const auto boot_time = BootTime();
  if (!boot_time) return std::nullopt;
  ProcessMetrics metrics;
  std::string field;
  for (int i = 3; i <= kResident; ++i) {
    if (!(fields >> field)) return std::nullopt;
    if (i == kUserTime || i == kSystemTime) metrics.cpu_seconds += std::stod(field) / ticks;
    if (i == kStart) metrics.start_time_seconds = *boot_time + std::stod(field) / ticks;
    if (i == kVirtual) metrics.virtual_bytes = std::stod(field);
    if (i == kResident) metrics.resident_bytes = std::stod(field) * page;
  }
  return metrics;
}

double AllocatedBytes() {
  const struct mallinfo2 heap = mallinfo2();  // of all arenas
  return static_cast<double>(heap.uordblks + heap.hblkhd);
}

double MaxDescriptors() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) {
    return std::numeric_limits<double>::infinity();
  }
  return static_cast<double>(limit.rlim_cur);
}

}  // namespace

std::optional<ProcessMetrics> ReadProcessMetrics() {
  auto metrics = ReadStat();
  if (!metrics) return std::nullopt;
  std::error_code error;
  for (std::filesystem::directory_iterator entry("/proc/self/fd", error), end;
       !error && entry != end; entry.increment(error)) {
    metrics->open_descriptors += 1.0;
  }
  metrics->open_descriptors -= 1.0;  // the descriptor that read this
  metrics->max_descriptors = MaxDescriptors();
  metrics->allocated_bytes = AllocatedBytes();
  return metrics;
}

}  // namespace maneuver::monitoring
