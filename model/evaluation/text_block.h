// Prints tables as plain text.

#ifndef MANEUVER_MODEL_EVALUATION_TEXT_BLOCK_H_
#define MANEUVER_MODEL_EVALUATION_TEXT_BLOCK_H_

#include <string>
#include <vector>

namespace maneuver::evaluation {

// A table with a title and right-aligned columns. Columns without a value are left out.
class Block {
 public:
  Block(std::string title, std::vector<std::string> columns);

  // Appends a row. Values missing at its end count as empty.
  void Add(std::string label, std::vector<std::string> values);
  bool empty() const { return cells_.size() == 1; }

  // Returns the lines, each with '\n' at its end; in colour, the first is bold.
  std::string Text(bool color) const;

 private:
  std::vector<std::vector<std::string>> cells_;  // titles first; each with its label
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_TEXT_BLOCK_H_
