#include "server/monitoring/prometheus_metrics.h"

#include <prometheus/collectable.h>
#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <atomic>
#include <iterator>
#include <map>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "server/monitoring/process_metrics.h"

namespace maneuver::monitoring {
namespace {

class PrometheusCounter final : public Counter {
 public:
  explicit PrometheusCounter(prometheus::Counter& counter) : counter_(counter) {}
  void Increment(double amount) override { counter_.Increment(amount); }

 private:
  prometheus::Counter& counter_;
};

class PrometheusGauge final : public Gauge {
 public:
  explicit PrometheusGauge(prometheus::Gauge& gauge) : gauge_(gauge) {}
  void Set(double value) override { gauge_.Set(value); }
  void Add(double amount) override { gauge_.Increment(amount); }

 private:
  prometheus::Gauge& gauge_;
};

class PrometheusHistogram final : public Histogram {
 public:
  explicit PrometheusHistogram(prometheus::Histogram& histogram) : histogram_(histogram) {}
  void Observe(double value) override { histogram_.Observe(value); }

 private:
  prometheus::Histogram& histogram_;
};

prometheus::MetricFamily Family(const char* name, const char* help, prometheus::MetricType type,
                                double value) {
  prometheus::ClientMetric metric;
  metric.gauge.value = value;
  metric.counter.value = value;
  return {name, help, type, {metric}};
}

// The metrics of the process, read each time the page is made.
class ProcessCollectable final : public prometheus::Collectable {
 public:
  std::vector<prometheus::MetricFamily> Collect() const override {
    using prometheus::MetricType;
    const auto process = ReadProcessMetrics();
    if (!process) return {};
    return {Family("process_cpu_seconds_total", "User and system time spent, seconds.",
                   MetricType::Counter, process->cpu_seconds),
            Family("process_start_time_seconds", "When the process was started, Unix time.",
                   MetricType::Gauge, process->start_time_seconds),
            Family("process_resident_memory_bytes", "Memory that is in use, bytes.",
                   MetricType::Gauge, process->resident_bytes),
            Family("maneuver_allocated_bytes",
                   "Memory that is allocated and not freed, bytes. It grows if the server leaks.",
                   MetricType::Gauge, process->allocated_bytes),
            Family("process_virtual_memory_bytes", "Memory that is mapped, bytes.",
                   MetricType::Gauge, process->virtual_bytes),
            Family("process_open_fds", "Open file descriptors.", MetricType::Gauge,
                   process->open_descriptors),
            Family("process_max_fds", "Most file descriptors that may be open.", MetricType::Gauge,
                   process->max_descriptors)};
  }
};

// The space on a folder's disk, read each time the page is made. A disk that does not answer takes
// one page with it; further ones, and those that are made at the same moment, say what was read last.
class DiskCollectable final : public prometheus::Collectable {
 public:
  explicit DiskCollectable(std::filesystem::path folder) : folder_(std::move(folder)) {}

  std::vector<prometheus::MetricFamily> Collect() const override {
    using prometheus::MetricType;
    if (!is_asked_.exchange(true)) {
      std::error_code error;
      const auto space = std::filesystem::space(folder_, error);
      const MutexLock lock(mutex_);
      last_ = error ? std::nullopt : std::optional(space);
      is_asked_ = false;
    }
    const MutexLock lock(mutex_);
    if (!last_) return {};
    return {Family("maneuver_data_disk_bytes", "Size of the disk that holds the data folder.",
                   MetricType::Gauge, static_cast<double>(last_->capacity)),
            Family("maneuver_data_disk_free_bytes",
                   "Bytes that the server can still write to the disk that holds the data folder.",
                   MetricType::Gauge, static_cast<double>(last_->available))};
  }

 private:
  const std::filesystem::path folder_;
  mutable std::atomic<bool> is_asked_ = false;
  mutable Mutex mutex_;
  mutable std::optional<std::filesystem::space_info> last_ ABSL_GUARDED_BY(mutex_);
};

class PrometheusRegistry final : public PrometheusMetrics {
 public:
  PrometheusRegistry() : registry_(std::make_shared<prometheus::Registry>()) {}

  Counter& AddCounter(const std::string& name, const std::string& help,
                      const Labels& labels) override {
    const MutexLock lock(mutex_);
    return Wrap(counters_,
                prometheus::BuildCounter().Name(name).Help(help).Register(*registry_).Add(labels));
  }

  Gauge& AddGauge(const std::string& name, const std::string& help, const Labels& labels) override {
    const MutexLock lock(mutex_);
    return Wrap(gauges_,
                prometheus::BuildGauge().Name(name).Help(help).Register(*registry_).Add(labels));
  }

  Histogram& AddHistogram(const std::string& name, const std::string& help,
                          const std::vector<double>& buckets, const Labels& labels) override {
    const MutexLock lock(mutex_);
    return Wrap(histograms_, prometheus::BuildHistogram()
                                 .Name(name)
                                 .Help(help)
                                 .Register(*registry_)
                                 .Add(labels, buckets));
  }

  void WatchDisk(const std::filesystem::path& folder) override {
    looked_at_.push_back(std::make_shared<DiskCollectable>(folder));
  }

  std::string Page() const override {
    auto families = registry_->Collect();
    for (const auto& each : looked_at_) {
      std::ranges::move(each->Collect(), std::back_inserter(families));
    }
    return prometheus::TextSerializer().Serialize(families);
  }

 private:
  // Wraps each of Prometheus' metrics once. Their addresses are stable.
  template <typename Wrapper, typename Metric>
  static Wrapper& Wrap(std::map<Metric*, Wrapper>& wrappers, Metric& metric) {
    return wrappers.try_emplace(&metric, metric).first->second;
  }

  const std::shared_ptr<prometheus::Registry> registry_;
  // What is read each time the page is made.
  std::vector<std::shared_ptr<prometheus::Collectable>> looked_at_ = {
      std::make_shared<ProcessCollectable>()};
  Mutex mutex_;
  // The elements of the maps never move.
  std::map<prometheus::Counter*, PrometheusCounter> counters_ ABSL_GUARDED_BY(mutex_);
  std::map<prometheus::Gauge*, PrometheusGauge> gauges_ ABSL_GUARDED_BY(mutex_);
  std::map<prometheus::Histogram*, PrometheusHistogram> histograms_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

std::unique_ptr<PrometheusMetrics> PrometheusMetrics::Create() {
  return std::make_unique<PrometheusRegistry>();
}

HttpPage MetricsPage(const PrometheusMetrics& metrics) {
  return {.path = "/metrics",
          .content_type = "text/plain; version=0.0.4; charset=utf-8",
          .make = [&metrics](std::string_view) {
            return HttpAnswer{200, metrics.Page()};
          }};
}

}  // namespace maneuver::monitoring
