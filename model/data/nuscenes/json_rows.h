// Reads large JSON files row by row: no more than one row is in memory.

#ifndef MANEUVER_MODEL_DATA_NUSCENES_JSON_ROWS_H_
#define MANEUVER_MODEL_DATA_NUSCENES_JSON_ROWS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"

namespace maneuver::data {

// An object within a file. Its methods return the fields of the object, and keep the first problem
// that they find: a missing field, a wrong type, a number out of range. Valid only until the call
// that receives it returns.
class JsonRow {
 public:
  //   place: where the object is, such as "sample.json[17]"
  //   problem: receives the first problem, as "sample.json[17].timestamp: must be a number"
  JsonRow(const nlohmann::json& value, std::function<std::string()> place, std::string* problem)
      : value_(value), place_(std::move(place)), problem_(problem) {}

  bool ok() const { return problem_->empty(); }
  // Returns INVALID_ARGUMENT with the first problem, or OK.
  absl::Status status() const;
  // Adds a problem of a field.
  void Fail(std::string_view field, std::string_view problem) const;

  // Returns a text. An empty one counts as missing.
  std::string Text(const char* field) const;
  // Returns "" if the field is missing or null.
  std::string TextOrNone(const char* field) const;
  bool Flag(const char* field) const;
  int64_t Whole(const char* field) const;
  // Returns a number whose magnitude is at most `most`.
  double Number(const char* field, double most) const;
  // Returns exactly N numbers, each with a magnitude of at most `most`.
  template <size_t N>
  std::array<double, N> Numbers(const char* field, double most) const {
    std::array<double, N> numbers{};
    ReadNumbers(field, most, numbers);
    return numbers;
  }
  // Returns the texts of an array. Leaves out null, which the published maps have.
  std::vector<std::string> Texts(const char* field) const;
  // Returns the objects of an array.
  std::vector<JsonRow> Rows(const char* field) const;
  // Returns the objects of an array that is the row itself.
  std::vector<JsonRow> Elements() const;

 private:
  const nlohmann::json* Find(const char* field) const;
  void ReadNumbers(const char* field, double most, std::span<double> numbers) const;
  std::vector<JsonRow> ElementsOf(const nlohmann::json& array, const std::string& field) const;

  const nlohmann::json& value_;
  std::function<std::string()> place_;
  std::string* problem_;
};

// Visits a row. `table` is the member that the row is in, "" in a file that is an array. `key` is
// the row's own name if the table is an object, otherwise "". If the result is an error, reading
// ends with it.
using VisitRow =
    std::function<absl::Status(std::string_view table, std::string_view key, const JsonRow& row)>;

// Reads a file that is either an array of rows, or an object whose members are tables: arrays or
// objects of rows. Other members are left out.
//   tables: the names of the tables to read; the others are skipped
//   progress: called now and then with the number of bytes read so far
// NOT_FOUND if there is no file. DATA_LOSS with file and byte if it is not such JSON, ends too
// early, or has a row of more than kMostValuesPerRow values.
absl::Status ReadJsonRows(const std::filesystem::path& file,
                          std::span<const std::string_view> tables, const VisitRow& visit,
                          const std::function<void(double bytes)>& progress);

inline constexpr size_t kMostValuesPerRow = 4'000'000;

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_NUSCENES_JSON_ROWS_H_
