// Private to onnx/: writes a graph node by node.

#ifndef MANEUVER_MODEL_ONNX_GRAPH_BUILDER_H_
#define MANEUVER_MODEL_ONNX_GRAPH_BUILDER_H_

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "onnx_file.pb.h"

namespace maneuver::onnx {

// The sizes of an input or output. -1 stands for any number of scenes.
using Sizes = std::vector<int64_t>;

// An attribute of a node: one integer, a list of them, or a float.
struct Attribute {
  std::string name;
  std::vector<int64_t> numbers;
  bool list = false;
  float real = 0.0f;

  static Attribute One(std::string name, int64_t number) { return {std::move(name), {number}}; }
  static Attribute List(std::string name, std::vector<int64_t> numbers) {
    return {std::move(name), std::move(numbers), true};
  }
  static Attribute Real(std::string name, float real) { return {std::move(name), {}, false, real}; }
};

class GraphBuilder {
 public:
  explicit GraphBuilder(GraphProto* graph) : graph_(*graph) {}

  void Input(const std::string& name, const Sizes& sizes);
  void Output(const std::string& name, const Sizes& sizes);

  // Add a constant and return its name.
  std::string Floats(const std::string& name, const Sizes& sizes, std::span<const float> values);
  std::string Integers(const std::string& name, std::span<const int64_t> values);

  // Adds a node with one output. Returns the output's name, which is `name`.
  std::string Add(const std::string& op, const std::string& name,
                  const std::vector<std::string>& inputs,
                  const std::vector<Attribute>& attributes = {});

 private:
  GraphProto& graph_;
};

}  // namespace maneuver::onnx

#endif  // MANEUVER_MODEL_ONNX_GRAPH_BUILDER_H_
