#include "model/data/nuscenes/json_rows.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"

namespace maneuver::data {
namespace {

using nlohmann::json;

constexpr int64_t kRowsPerProgress = 4096;

// Builds one row at a time from the events of the parser.
class RowBuilder final : public nlohmann::json_sax<json> {
 public:
  RowBuilder(std::string name, std::span<const std::string_view> tables, const VisitRow& visit,
             std::function<void()> progress)
      : name_(std::move(name)), tables_(tables), visit_(visit), progress_(std::move(progress)) {}

  const absl::Status& status() const { return status_; }

  bool null() override { return Scalar(nullptr); }
  bool boolean(bool value) override { return Scalar(value); }
  bool number_integer(number_integer_t value) override { return Scalar(value); }
  bool number_unsigned(number_unsigned_t value) override { return Scalar(value); }
  bool number_float(number_float_t value, const string_t&) override { return Scalar(value); }
  bool string(string_t& value) override { return Scalar(std::move(value)); }
  bool binary(binary_t&) override { return false; }
  bool start_object(size_t) override { return Start(json::object()); }
  bool start_array(size_t) override { return Start(json::array()); }
  bool end_object() override { return End(); }
  bool end_array() override { return End(); }

  bool key(string_t& value) override {
    if (!stack_.empty()) {
      key_ = std::move(value);
    } else if (depth_ == 1) {
      table_ = std::move(value);
      row_key_.clear();
      index_ = 0;
    } else {
      row_key_ = std::move(value);
    }
    return true;
  }

  bool parse_error(size_t position, const std::string&, const json::exception& error) override {
    // What the library adds in front, "[json.exception...] ", says nothing to a user.
    const std::string text = error.what();
    const size_t begin = text.find("] ");
    status_ = absl::DataLossError(
        absl::StrCat(name_, ": no JSON at byte ", position, ": ",
                     begin == std::string::npos ? text : text.substr(begin + 2)));
    return false;
  }

 private:
  // The depth at which rows begin: 1 in an array, 2 in an object of tables.
  int row_depth() const { return is_array_ ? 1 : 2; }
  bool Wanted() const {
    return is_array_ || std::find(tables_.begin(), tables_.end(), table_) != tables_.end();
  }

  bool Scalar(json value) {
    if (!stack_.empty()) return Insert(std::move(value)) != nullptr;
    if (depth_ == 0) return Refuse("must be an array or an object");
    if (depth_ == 1 && !is_array_) return true;  // version, canvas_edge
    return !Wanted() || Deliver(value);
  }

  bool Start(json container) {
    if (depth_ == 0) {
      is_array_ = container.is_array();
    } else if (!stack_.empty()) {
      json* const inserted = Insert(std::move(container));
      if (inserted == nullptr) return false;
      stack_.push_back(inserted);
    } else if (depth_ == row_depth() && Wanted()) {
      row_ = std::move(container);
      values_ = 0;
      stack_.push_back(&row_);
    }
    ++depth_;
    return true;
  }

  bool End() {
    --depth_;
    if (stack_.empty()) return true;
    stack_.pop_back();
    return !stack_.empty() || Deliver(row_);
  }

  // Returns the place of the value in the row, or nullptr if the row is too large.
  json* Insert(json value) {
    if (++values_ > kMostValuesPerRow) {
      Refuse(absl::StrCat("[", index_, "]: has more than ", kMostValuesPerRow, " values"));
      return nullptr;
    }
    json& container = *stack_.back();
    if (container.is_object()) return &(container[key_] = std::move(value));
    container.push_back(std::move(value));
    return &container.back();
  }

  bool Deliver(const json& value) {
    std::string problem;
    const JsonRow row(
        value, [this] { return Place(); }, &problem);
    status_ = visit_(table_, row_key_, row);
    ++index_;
    row_key_.clear();
    if (++rows_ % kRowsPerProgress == 0) progress_();
    return status_.ok();
  }

  std::string Place() const {
    if (is_array_) return absl::StrCat(name_, "[", index_, "]");
    const std::string table = absl::StrCat(name_, ": ", table_);
    return row_key_.empty() ? absl::StrCat(table, "[", index_, "]")
                            : absl::StrCat(table, ".", row_key_);
  }

  bool Refuse(const std::string& problem) {
    status_ = absl::DataLossError(absl::StrCat(name_, ": ", problem));
    return false;
  }

  const std::string name_;
  const std::span<const std::string_view> tables_;
  const VisitRow& visit_;
  const std::function<void()> progress_;
  absl::Status status_;

  bool is_array_ = false;
  int depth_ = 0;  // of containers that are open
  std::string table_;
  std::string row_key_;
  int64_t index_ = 0;  // of the row in its table
  int64_t rows_ = 0;   // in all
  json row_;
  std::vector<json*> stack_;  // containers of the row that are open
  std::string key_;           // of the next value within the row
  size_t values_ = 0;         // of the row
};

}  // namespace

absl::Status JsonRow::status() const {
  return ok() ? absl::OkStatus() : absl::InvalidArgumentError(*problem_);
}

void JsonRow::Fail(std::string_view field, std::string_view problem) const {
  if (!ok()) return;
  *problem_ = place_();
  if (!field.empty()) absl::StrAppend(problem_, ".", std::string(field));
  absl::StrAppend(problem_, ": ", std::string(problem));
}

const json* JsonRow::Find(const char* field) const {
  if (!value_.is_object()) {
    Fail("", "must be an object");
    return nullptr;
  }
  const auto found = value_.find(field);
  if (found != value_.end()) return &*found;
  Fail(field, "is missing");
  return nullptr;
}

std::string JsonRow::Text(const char* field) const {
  const json* const value = Find(field);
  if (value == nullptr) return "";
  const auto* const text = value->get_ptr<const std::string*>();
  if (text == nullptr) Fail(field, "must be a text");
  if (text != nullptr && text->empty()) Fail(field, "is empty");
  return text == nullptr ? "" : *text;
}

std::string JsonRow::TextOrNone(const char* field) const {
  if (!value_.is_object() || !value_.contains(field) || value_[field].is_null()) return "";
  const auto* const text = value_[field].get_ptr<const std::string*>();
  if (text == nullptr) Fail(field, "must be a text");
  return text == nullptr ? "" : *text;
}

bool JsonRow::Flag(const char* field) const {
  const json* const value = Find(field);
  if (value == nullptr) return false;
  const auto* const flag = value->get_ptr<const bool*>();
  if (flag == nullptr) Fail(field, "must be true or false");
  return flag != nullptr && *flag;
}

int64_t JsonRow::Whole(const char* field) const {
  const json* const value = Find(field);
  if (value == nullptr) return 0;
  if (value->is_number_unsigned() && value->get<uint64_t>() <= uint64_t{INT64_MAX}) {
    return static_cast<int64_t>(value->get<uint64_t>());
  }
  if (!value->is_number_integer() || value->is_number_unsigned()) {
    Fail(field, "must be a whole number");
    return 0;
  }
  return value->get<int64_t>();
}

double JsonRow::Number(const char* field, double most) const {
  const json* const value = Find(field);
  if (value == nullptr) return 0.0;
  const double number = value->is_number() ? value->get<double>() : NAN;
  if (!(std::abs(number) <= most)) {
    Fail(field, absl::StrCat("must be a number between ", -most, " and ", most));
    return 0.0;
  }
  return number;
}

void JsonRow::ReadNumbers(const char* field, double most, std::span<double> numbers) const {
  const json* const value = Find(field);
  if (value == nullptr) return;
  bool good = value->is_array() && value->size() == numbers.size();
  for (size_t i = 0; good && i < numbers.size(); ++i) {
    const json& element = (*value)[i];
    numbers[i] = element.is_number() ? element.get<double>() : NAN;
    good = std::abs(numbers[i]) <= most;
  }
  if (good) return;
  Fail(field, absl::StrCat("must be ", numbers.size(), " numbers between ", -most, " and ", most));
  std::fill(numbers.begin(), numbers.end(), 0.0);
}

std::vector<std::string> JsonRow::Texts(const char* field) const {
  std::vector<std::string> texts;
  const json* const value = Find(field);
  if (value == nullptr) return texts;
  if (!value->is_array()) Fail(field, "must be an array of texts");
  if (!value->is_array()) return texts;
  for (const json& element : *value) {
    if (element.is_null()) continue;
    const auto* const text = element.get_ptr<const std::string*>();
    if (text == nullptr) {
      Fail(field, "must be an array of texts");
      return texts;
    }
    texts.push_back(*text);
  }
  return texts;
}

std::vector<JsonRow> JsonRow::Rows(const char* field) const {
  const json* const value = Find(field);
  return value == nullptr ? std::vector<JsonRow>() : ElementsOf(*value, field);
}

std::vector<JsonRow> JsonRow::Elements() const { return ElementsOf(value_, ""); }

std::vector<JsonRow> JsonRow::ElementsOf(const json& array, const std::string& field) const {
  std::vector<JsonRow> rows;
  if (!array.is_array()) {
    Fail(field, "must be an array");
    return rows;
  }
  for (const json& element : array) {
    const size_t i = rows.size();
    rows.emplace_back(
        element,
        [place = place_, field, i] {
          return absl::StrCat(place(), field.empty() ? "" : ".", field, "[", i, "]");
        },
        problem_);
  }
  return rows;
}

absl::Status ReadJsonRows(const std::filesystem::path& file,
                          std::span<const std::string_view> tables, const VisitRow& visit,
                          const std::function<void(double bytes)>& progress) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return files::ErrnoStatus(errno, "open", file);
  RowBuilder rows(files::NameOf(file), tables, visit,
                  [&] { progress(std::max(0.0, static_cast<double>(stream.tellg()))); });
  if (!json::sax_parse(stream, &rows) && rows.status().ok()) {
    return absl::DataLossError(absl::StrCat(files::NameOf(file), ": no JSON"));
  }
  return rows.status();
}

}  // namespace maneuver::data
