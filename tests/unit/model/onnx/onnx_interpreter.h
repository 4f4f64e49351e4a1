// Evaluates ONNX files as the operators' specification says, in double precision and as plainly as
// can be: what exported networks are held against where OpenCV's importer lacks an operator.

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

// Returns all values of the graph by name, outputs among them. Aborts with the name of the node for
// a file that does not parse, an operator that it does not know, an input of the graph that is not
// given or has another size than the file says, or sizes that do not fit.
Arrays Evaluate(const std::string& file, const Arrays& inputs);

}  // namespace maneuver::onnx

#endif  // MANEUVER_TESTS_UNIT_MODEL_ONNX_ONNX_INTERPRETER_H_
