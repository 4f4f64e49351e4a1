#include "tests/bench/yardsticks.h"

#include <benchmark/benchmark.h>
#include <omp.h>

#include <Eigen/Core>
#include <cstring>
#include <dnnl.hpp>
#include <fstream>
#include <unordered_map>
#include <utility>

#include "model/inference/backbone.h"

namespace maneuver::bench {
namespace {

using dnnl::memory;

constexpr memory::dim kSize = 768;  // three matrices of it lie in the second and third cache

// A prepared product C = A B in one precision.
struct Product {
  Product(const dnnl::engine& engine, memory::data_type type) : stream(engine) {
    const memory::desc any({kSize, kSize}, type, memory::format_tag::any);
    const memory::desc output({kSize, kSize}, memory::data_type::f32, memory::format_tag::ab);
    const dnnl::matmul::primitive_desc description({any, any, output}, engine);
    primitive = dnnl::matmul(description);
    const memory a(description.src_desc(), engine);
    const memory b(description.weights_desc(), engine);
    const memory c(description.dst_desc(), engine);
    std::memset(a.get_data_handle(), 0, description.src_desc().get_size());
    std::memset(b.get_data_handle(), 0, description.weights_desc().get_size());
    arguments = {{DNNL_ARG_SRC, a}, {DNNL_ARG_WEIGHTS, b}, {DNNL_ARG_DST, c}};
  }

  void Run() {
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    primitive.execute(stream, arguments);
    stream.wait();
    omp_set_num_threads(threads);
  }

  dnnl::stream stream;
  dnnl::matmul primitive;
  std::unordered_map<int, memory> arguments;
};

}  // namespace

struct Yardsticks::Buffers {
  explicit Buffers(size_t bytes)
      : engine(dnnl::engine::kind::cpu, 0),
        f32(engine, memory::data_type::f32),
        from(Eigen::ArrayXf::Ones(static_cast<Eigen::Index>(bytes / sizeof(float)))),
        to(Eigen::ArrayXf::Zero(from.size())) {
    if (inference::ProcessorHasBf16()) {
      bf16 = std::make_unique<Product>(engine, memory::data_type::bf16);
    }
  }

  dnnl::engine engine;
  Product f32;
  std::unique_ptr<Product> bf16;
  Eigen::ArrayXf from;
  Eigen::ArrayXf to;
};

Yardsticks::Yardsticks(size_t bytes) : buffers_(std::make_unique<Buffers>(bytes)) {}
Yardsticks::~Yardsticks() = default;

void Yardsticks::MultiplyF32() { buffers_->f32.Run(); }
void Yardsticks::MultiplyBf16() { buffers_->bf16->Run(); }

double Yardsticks::operations() {
  return 2.0 * static_cast<double>(kSize) * static_cast<double>(kSize) * static_cast<double>(kSize);
}

void Yardsticks::Read() { benchmark::DoNotOptimize(buffers_->from.sum()); }

void Yardsticks::Copy() {
  std::memcpy(buffers_->to.data(), buffers_->from.data(), static_cast<size_t>(bytes()));
  benchmark::ClobberMemory();
}

double Yardsticks::bytes() const {
  return static_cast<double>(buffers_->from.size()) * sizeof(float);
}

std::string ProcessorName() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("model name")) continue;
    const size_t colon = line.find(": ");
    if (colon != std::string::npos) return line.substr(colon + 2);
  }
  return "an unnamed processor";
}

}  // namespace maneuver::bench
