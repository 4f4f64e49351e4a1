// Evaluates ONNX files by the operators' specification, in double precision and as plainly as
// possible. Tests compare exported networks with it where OpenCV's importer lacks an operator.

#ifndef MANEUVER_TESTS_UNIT_MODEL_ONNX_ONNX_INTERPRETER_H_
#define MANEUVER_TESTS_UNIT_MODEL_ONNX_ONNX_INTERPRETER_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace maneuver::onnx {

// Row-major.
struct Array {
  std::vector<int64_t> sizes;
  std::vector<double> values;  // product of sizes
};
using Arrays = std::map<std::string, Array>;

// Returns all values of the graph by name, including outputs. Aborts with the name of the node if
// the file does not parse, an operator is unknown, an input of the graph is missing or has another
// size than the file says, or sizes do not match.
Arrays Evaluate(const std::string& file, const Arrays& inputs);

}  // namespace maneuver::onnx

#endif  // MANEUVER_TESTS_UNIT_MODEL_ONNX_ONNX_INTERPRETER_H_
