#include "tests/unit/model/onnx/onnx_interpreter.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <iostream>
#include <numeric>
#include <span>

#include "onnx_file.pb.h"

namespace maneuver::onnx {
namespace {

[[noreturn]] void Fail(const std::string& node, const char* what) {
  std::cerr << "ONNX node " << node << ": " << what << "\n";
  std::abort();
}

int64_t Count(std::span<const int64_t> sizes) {
  return std::accumulate(sizes.begin(), sizes.end(), int64_t{1}, std::multiplies<>());
}

Array Zeros(std::vector<int64_t> sizes) {
  Array array{std::move(sizes), {}};
  array.values.resize(static_cast<size_t>(Count(array.sizes)));
  return array;
}

Array ToArray(const TensorProto& tensor) {
  Array array = Zeros({tensor.dims().begin(), tensor.dims().end()});
  const auto read = [&](auto value) {
    for (size_t i = 0; i < array.values.size(); ++i) {
      std::memcpy(&value, tensor.raw_data().data() + i * sizeof(value), sizeof(value));
      array.values[i] = static_cast<double>(value);
    }
  };
  if (tensor.data_type() == TensorProto::FLOAT) {
    read(float{});
  } else {
    read(int64_t{});
  }
  return array;
}

// Evaluates one node at a time.
class Evaluator {
 public:
  explicit Evaluator(Arrays* arrays) : arrays_(*arrays) {}

  void Run(const NodeProto& node) {
    node_ = &node;
    arrays_[node.output(0)] = Compute(node.op_type());
  }

 private:
  Array Compute(const std::string& op) {
    if (op == "Relu") return Map([](double x) { return std::max(x, 0.0); });
    if (op == "Exp") return Map([](double x) { return std::exp(x); });
    if (op == "Add") return Broadcast([](double a, double b) { return a + b; });
    if (op == "Mul") return Broadcast([](double a, double b) { return a * b; });
    if (op == "Gemm") return Gemm();
    if (op == "MatMul") return MatMul();
    if (op == "Reshape") return Reshape();
    if (op == "Flatten") return Flatten();
    if (op == "Concat") return Concat();
    if (op == "Slice") return Slice();
    if (op == "Softmax") return Softmax();
    if (op == "ReduceSum") return Reduce(Axis(1), 0.0, [](double a, double b) { return a + b; });
    if (op == "ReduceMax") {
      return Reduce(Attribute("axes")->ints(0), -HUGE_VAL,
                    [](double a, double b) { return std::max(a, b); });
    }
    if (op == "Conv") return Conv();
    if (op == "BatchNormalization") return BatchNormalization();
    Fail(node_->name(), ("unknown operator " + op).c_str());
  }

  const Array& In(int i) const {
    const auto found = arrays_.find(node_->input(i));
    if (found == arrays_.end()) Fail(node_->name(), "an input does not exist");
    return found->second;
  }
  const AttributeProto* Attribute(const std::string& name) const {
    for (const AttributeProto& attribute : node_->attribute()) {
      if (attribute.name() == name) return &attribute;
    }
    return nullptr;
  }
  int64_t Number(const std::string& name, int64_t otherwise) const {
    const AttributeProto* found = Attribute(name);
    return found == nullptr ? otherwise : found->i();
  }
  // Returns the single axis that a constant input names.
  int64_t Axis(int input) const { return static_cast<int64_t>(In(input).values.at(0)); }
  void Require(bool condition, const char* what) const {
    if (!condition) Fail(node_->name(), what);
  }

  template <typename Call>
  Array Map(Call call) const {
    Array array = In(0);
    for (double& value : array.values) value = call(value);
    return array;
  }

  // Axes are matched from the last one backwards; an axis of size 1 is repeated.
  template <typename Call>
  Array Broadcast(Call call) const {
    const size_t rank = std::max(In(0).sizes.size(), In(1).sizes.size());
    const auto padded = [&](const Array& array) {
      std::vector<int64_t> sizes(rank - array.sizes.size(), 1);
      sizes.insert(sizes.end(), array.sizes.begin(), array.sizes.end());
      return sizes;
    };
    const auto a = padded(In(0)), b = padded(In(1));
    Array result;
    for (size_t d = 0; d < rank; ++d) {
      Require(a[d] == b[d] || a[d] == 1 || b[d] == 1, "sizes cannot be matched");
      result.sizes.push_back(std::max(a[d], b[d]));
    }
    result = Zeros(result.sizes);
    std::vector<int64_t> at(rank);
    for (double& value : result.values) {
      int64_t place_a = 0, place_b = 0;
      for (size_t d = 0; d < rank; ++d) {
        place_a = place_a * a[d] + (a[d] == 1 ? 0 : at[d]);
        place_b = place_b * b[d] + (b[d] == 1 ? 0 : at[d]);
      }
      value = call(In(0).values[static_cast<size_t>(place_a)],
                   In(1).values[static_cast<size_t>(place_b)]);
      for (size_t d = rank; d-- > 0 && ++at[d] == result.sizes[d];) at[d] = 0;
    }
    return result;
  }

  // With transB, the only variant that is exported.
  Array Gemm() const {
    const Array &x = In(0), &w = In(1);
    Require(Number("transB", 0) == 1 && x.sizes.size() == 2 && x.sizes[1] == w.sizes[1],
            "sizes cannot be multiplied");
    Array y = Zeros({x.sizes[0], w.sizes[0]});
    double* out = y.values.data();
    for (int64_t n = 0; n < x.sizes[0]; ++n) {
      for (int64_t o = 0; o < w.sizes[0]; ++o, ++out) {
        if (node_->input_size() > 2) *out = In(2).values[static_cast<size_t>(o)];
        for (int64_t i = 0; i < x.sizes[1]; ++i) {
          *out += x.values[static_cast<size_t>(n * x.sizes[1] + i)] *
                  w.values[static_cast<size_t>(o * x.sizes[1] + i)];
        }
      }
    }
    return y;
  }

  // [N, K, R, I] times [1, K, I, O].
  Array MatMul() const {
    const Array &x = In(0), &w = In(1);
    Require(x.sizes.size() == 4 && w.sizes.size() == 4 && w.sizes[0] == 1 &&
                x.sizes[1] == w.sizes[1] && x.sizes[3] == w.sizes[2],
            "sizes cannot be multiplied");
    const int64_t K = x.sizes[1], R = x.sizes[2], I = x.sizes[3], O = w.sizes[3];
    Array y = Zeros({x.sizes[0], K, R, O});
    for (int64_t row = 0; row < x.sizes[0] * K * R; ++row) {
      const int64_t k = row / R % K;
      for (int64_t i = 0; i < I; ++i) {
        for (int64_t o = 0; o < O; ++o) {
          y.values[static_cast<size_t>(row * O + o)] +=
              x.values[static_cast<size_t>(row * I + i)] *
              w.values[static_cast<size_t>((k * I + i) * O + o)];
        }
      }
    }
    return y;
  }

  Array Reshape() const {
    Array array = In(0);
    array.sizes.assign(In(1).values.begin(), In(1).values.end());
    int64_t known = 1;
    for (const int64_t size : array.sizes) known *= size < 0 ? 1 : size;
    for (int64_t& size : array.sizes) {
      if (size < 0) size = static_cast<int64_t>(array.values.size()) / known;
    }
    Require(Count(array.sizes) == static_cast<int64_t>(array.values.size()),
            "there are more or fewer values than the new sizes hold");
    return array;
  }

  Array Flatten() const {
    Array array = In(0);
    array.sizes = {array.sizes[0], Count(array.sizes) / array.sizes[0]};
    return array;
  }

  // The numbers of values before, along and after an axis.
  struct Split {
    int64_t outer, size, inner;
  };
  static Split SplitAt(const Array& array, int64_t axis) {
    const std::span sizes(array.sizes);
    const auto at = static_cast<size_t>(axis);
    return {Count(sizes.first(at)), sizes[at], Count(sizes.subspan(at + 1))};
  }

  Array Concat() const {
    const int64_t axis = Number("axis", 0);
    Array result{In(0).sizes, {}};
    result.sizes[static_cast<size_t>(axis)] = 0;
    for (int i = 0; i < node_->input_size(); ++i) {
      result.sizes[static_cast<size_t>(axis)] += SplitAt(In(i), axis).size;
      Require(In(i).sizes.size() == result.sizes.size() &&
                  SplitAt(In(i), axis).outer == SplitAt(In(0), axis).outer &&
                  SplitAt(In(i), axis).inner == SplitAt(In(0), axis).inner,
              "parts have different sizes");
    }
    for (int64_t o = 0; o < SplitAt(In(0), axis).outer; ++o) {
      for (int i = 0; i < node_->input_size(); ++i) {
        const Split split = SplitAt(In(i), axis);
        const auto begin = In(i).values.begin() + o * split.size * split.inner;
        result.values.insert(result.values.end(), begin, begin + split.size * split.inner);
      }
    }
    return result;
  }

  Array Slice() const {
    const int64_t from = Axis(1), to = Axis(2), axis = Axis(3);
    const Split split = SplitAt(In(0), axis);
    Require(0 <= from && from < to && to <= split.size, "there is no such slice");
    Array result{In(0).sizes, {}};
    result.sizes[static_cast<size_t>(axis)] = to - from;
    for (int64_t o = 0; o < split.outer; ++o) {
      const auto begin = In(0).values.begin() + o * split.size * split.inner;
      result.values.insert(result.values.end(), begin + from * split.inner,
                           begin + to * split.inner);
    }
    return result;
  }

  Array Softmax() const {
    Array result = In(0);
    const Split split = SplitAt(result, Number("axis", -1));
    for (int64_t o = 0; o < split.outer; ++o) {
      for (int64_t i = 0; i < split.inner; ++i) {
        const auto at = [&](int64_t s) -> double& {
          return result.values[static_cast<size_t>((o * split.size + s) * split.inner + i)];
        };
        double largest = -HUGE_VAL, sum = 0.0;
        for (int64_t s = 0; s < split.size; ++s) largest = std::max(largest, at(s));
        for (int64_t s = 0; s < split.size; ++s) sum += at(s) = std::exp(at(s) - largest);
        for (int64_t s = 0; s < split.size; ++s) at(s) /= sum;
      }
    }
    return result;
  }

  template <typename Call>
  Array Reduce(int64_t axis, double start, Call call) const {
    Require(Number("keepdims", 1) == 0, "keeps the axis");
    const Split split = SplitAt(In(0), axis);
    std::vector<int64_t> sizes = In(0).sizes;
    sizes.erase(sizes.begin() + axis);
    Array result = Zeros(sizes);
    std::fill(result.values.begin(), result.values.end(), start);
    for (int64_t o = 0; o < split.outer; ++o) {
      for (int64_t s = 0; s < split.size; ++s) {
        for (int64_t i = 0; i < split.inner; ++i) {
          double& value = result.values[static_cast<size_t>(o * split.inner + i)];
          value = call(value,
                       In(0).values[static_cast<size_t>((o * split.size + s) * split.inner + i)]);
        }
      }
    }
    return result;
  }

  // [N, C, H, W] with [O, C, kernel, kernel], padded equally on all sides.
  Array Conv() const {
    const Array &x = In(0), &w = In(1);
    const int64_t stride = Attribute("strides")->ints(0), pad = Attribute("pads")->ints(0);
    const int64_t C = x.sizes[1], H = x.sizes[2], W = x.sizes[3], kernel = w.sizes[2];
    Require(w.sizes[1] == C, "another number of channels");
    const auto outputs = [&](int64_t size) { return (size + 2 * pad - kernel) / stride + 1; };
    Array y = Zeros({x.sizes[0], w.sizes[0], outputs(H), outputs(W)});
    double* out = y.values.data();
    for (int64_t n = 0; n < y.sizes[0]; ++n) {
      for (int64_t o = 0; o < y.sizes[1]; ++o) {
        for (int64_t row = 0; row < y.sizes[2]; ++row) {
          for (int64_t column = 0; column < y.sizes[3]; ++column, ++out) {
            for (int64_t tap = 0; tap < C * kernel * kernel; ++tap) {
              const int64_t r = row * stride - pad + tap / kernel % kernel;
              const int64_t c = column * stride - pad + tap % kernel;
              if (r < 0 || r >= H || c < 0 || c >= W) continue;
              const int64_t channel = tap / (kernel * kernel);
              *out += x.values[static_cast<size_t>(((n * C + channel) * H + r) * W + c)] *
                      w.values[static_cast<size_t>(o * C * kernel * kernel + tap)];
            }
          }
        }
      }
    }
    return y;
  }

  Array BatchNormalization() const {
    Array result = In(0);
    const Split split = SplitAt(result, 1);
    const double epsilon = static_cast<double>(Attribute("epsilon")->f());
    for (size_t i = 0; i < result.values.size(); ++i) {
      const size_t c = i / static_cast<size_t>(split.inner) % static_cast<size_t>(split.size);
      result.values[i] = (result.values[i] - In(3).values[c]) /
                             std::sqrt(In(4).values[c] + epsilon) * In(1).values[c] +
                         In(2).values[c];
    }
    return result;
  }

  Arrays& arrays_;
  const NodeProto* node_ = nullptr;
};

}  // namespace

Arrays Evaluate(const std::string& file, const Arrays& inputs) {
  ModelProto model;
  if (!model.ParseFromString(file)) Fail("", "the file does not parse");
  Arrays arrays;
  for (const TensorProto& constant : model.graph().initializer()) {
    if (!arrays.emplace(constant.name(), ToArray(constant)).second) {
      Fail(constant.name(), "is there twice");
    }
  }
  for (const ValueInfoProto& input : model.graph().input()) {
    const auto given = inputs.find(input.name());
    if (given == inputs.end()) Fail(input.name(), "is not given");
    const auto& sizes = input.type().tensor_type().shape();
    bool fits = sizes.dim_size() == static_cast<int>(given->second.sizes.size());
    for (int d = 0; fits && d < sizes.dim_size(); ++d) {
      fits = !sizes.dim(d).dim_param().empty() ||
             sizes.dim(d).dim_value() == given->second.sizes[static_cast<size_t>(d)];
    }
    if (!fits) Fail(input.name(), "has another size");
    arrays.insert(*given);
  }
  Evaluator evaluator(&arrays);
  for (const NodeProto& node : model.graph().node()) evaluator.Run(node);
  for (const ValueInfoProto& output : model.graph().output()) {
    if (!arrays.contains(output.name())) Fail(output.name(), "is written by no node");
  }
  return arrays;
}

}  // namespace maneuver::onnx
