#include "model/onnx/graph_builder.h"

#include <bit>

namespace maneuver::onnx {
namespace {

static_assert(std::endian::native == std::endian::little, "raw_data is little-endian");

void Describe(const std::string& name, const Sizes& sizes, ValueInfoProto* value) {
  value->set_name(name);
  TypeProto::Tensor* type = value->mutable_type()->mutable_tensor_type();
  type->set_elem_type(TensorProto::FLOAT);
  for (const int64_t size : sizes) {
    auto* dimension = type->mutable_shape()->add_dim();
    if (size < 0) {
      dimension->set_dim_param("N");
    } else {
      dimension->set_dim_value(size);
    }
  }
}

template <typename Value>
std::string AddConstant(const std::string& name, const Sizes& sizes, TensorProto::DataType type,
                        std::span<const Value> values, GraphProto* graph) {
  TensorProto* tensor = graph->add_initializer();
  tensor->set_name(name);
  tensor->set_data_type(type);
  tensor->mutable_dims()->Assign(sizes.begin(), sizes.end());
  tensor->set_raw_data(values.data(), values.size_bytes());
  return name;
}

}  // namespace

void GraphBuilder::Input(const std::string& name, const Sizes& sizes) {
  Describe(name, sizes, graph_.add_input());
}

void GraphBuilder::Output(const std::string& name, const Sizes& sizes) {
  Describe(name, sizes, graph_.add_output());
}

std::string GraphBuilder::Floats(const std::string& name, const Sizes& sizes,
                                 std::span<const float> values) {
  return AddConstant(name, sizes, TensorProto::FLOAT, values, &graph_);
}

std::string GraphBuilder::Integers(const std::string& name, std::span<const int64_t> values) {
  return AddConstant(name, {static_cast<int64_t>(values.size())}, TensorProto::INT64, values,
                     &graph_);
}

std::string GraphBuilder::Add(const std::string& op, const std::string& name,
                              const std::vector<std::string>& inputs,
                              const std::vector<Attribute>& attributes) {
  NodeProto* node = graph_.add_node();
  node->set_op_type(op);
  node->set_name(name);
  for (const std::string& input : inputs) node->add_input(input);
  node->add_output(name);
  for (const Attribute& attribute : attributes) {
    AttributeProto* added = node->add_attribute();
    added->set_name(attribute.name);
    if (attribute.numbers.empty()) {
      added->set_type(AttributeProto::FLOAT);
      added->set_f(attribute.real);
    } else if (attribute.list) {
      added->set_type(AttributeProto::INTS);
      added->mutable_ints()->Assign(attribute.numbers.begin(), attribute.numbers.end());
    } else {
      added->set_type(AttributeProto::INT);
      added->set_i(attribute.numbers.front());
    }
  }
  return name;
}

}  // namespace maneuver::onnx
