#include "model/evaluation/text_block.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::evaluation {

Block::Block(std::string title, std::vector<std::string> columns) : cells_({std::move(columns)}) {
  cells_.front().insert(cells_.front().begin(), std::move(title));
}

void Block::Add(std::string label, std::vector<std::string> values) {
  values.insert(values.begin(), std::move(label));
  values.resize(cells_.front().size());
  cells_.push_back(std::move(values));
}

std::string Block::Text(bool color) const {
  std::vector<size_t> widths;  // 0: left out
  for (size_t column = 0; column < cells_.front().size(); ++column) {
    size_t width = 0;
    for (size_t row = 1; row < cells_.size(); ++row) {
      width = std::max(width, cells_[row][column].size());
    }
    widths.push_back(width == 0 ? 0 : std::max(width, cells_.front()[column].size()));
  }
  std::string text;
  for (size_t row = 0; row < cells_.size(); ++row) {
    std::string line = cells_[row][0] + std::string(widths[0] - cells_[row][0].size(), ' ');
    for (size_t column = 1; column < widths.size(); ++column) {
      if (widths[column] == 0) continue;
      const std::string& cell = cells_[row][column];
      absl::StrAppend(&line, "  ", std::string(widths[column] - cell.size(), ' '), cell);
    }
    line.erase(line.find_last_not_of(' ') + 1);
    if (row == 0 && color) line = absl::StrCat("\x1b[1m", line, "\x1b[0m");
    absl::StrAppend(&text, line, "\n");
  }
  return text;
}

}  // namespace maneuver::evaluation
