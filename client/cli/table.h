// Text tables for people.

#ifndef MANEUVER_CLIENT_CLI_TABLE_H_
#define MANEUVER_CLIENT_CLI_TABLE_H_

#include <string>
#include <string_view>
#include <vector>

namespace maneuver::cli {

enum class Align { kLeft, kRight };

struct Column {
  std::string title;
  Align align = Align::kLeft;
};

// Aligned columns, two spaces apart, under a line of titles. Without colour it is plain text.
// Control characters in titles and cells are escaped: see Printable.
class Table {
 public:
  explicit Table(std::vector<Column> columns);

  // Adds a row. `cells` has one cell for each column.
  void Add(std::vector<std::string> cells);
  bool empty() const { return rows_.empty(); }

  // Returns the table as text. Lines end in '\n' and have no trailing spaces.
  std::string Text(bool color) const;
  // Returns the table in Markdown.
  std::string Markdown() const;

 private:
  std::vector<Column> columns_;
  std::vector<std::vector<std::string>> rows_;
};

// Returns the number of characters of UTF-8 text.
size_t DisplayWidth(std::string_view text);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TABLE_H_
