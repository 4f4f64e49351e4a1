// Writes a folder of tags with rows of random numbers, to measure `maneuver find` with:
//
//   make_tags FOLDER ROWS [SHARDS]

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/tags/shard_tags.h"
#include "model/tags/tag_folder.h"

namespace maneuver::bench {
namespace {

using tags::Column;

constexpr int kActions = 25;
constexpr int64_t kRowsOfScene = 100;

int Main(int argc, char** argv) {
  if (argc < 3) {
    std::cerr << "make_tags FOLDER ROWS [SHARDS]\n";
    return 2;
  }
  const int64_t rows = std::atoll(argv[2]);
  const int shards = argc > 3 ? std::atoi(argv[3]) : 20;
  tags::TagSchema content;
  content.set_format_version(tags::kTagFormatVersion);
  content.set_merged(true);
  for (int i = 0; i < kActions; ++i) content.add_action_names(absl::StrCat("action ", i));
  for (tags::TagColumn& column : tags::CsvColumns()) *content.add_columns() = std::move(column);
  for (int i = 0; i < shards; ++i) {
    tags::TagFile* file = content.add_files();
    file->set_name(absl::StrCat("made-", i));
    file->set_dataset("made");
  }
  const auto schema = tags::PrepareTagFolder(argv[1], content);
  if (!schema.ok()) return std::cerr << schema.status() << "\n", 1;
  std::mt19937_64 random(1);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int shard = 0; shard < shards; ++shard) {
    auto writer = tags::ShardTagsWriter::Create(argv[1], *schema, content.files(shard));
    if (!writer.ok()) return std::cerr << writer.status() << "\n", 1;
    for (int64_t left = rows / shards, scene = 0; left > 0; left -= kRowsOfScene, ++scene) {
      std::vector<tags::CsvRow> made(static_cast<size_t>(std::min(left, kRowsOfScene)));
      double time = 0.0;
      for (size_t i = 0; i < made.size(); ++i) {
        tags::TagRow& row = made[i].row;
        const auto set = [&row](Column column, double number) {
          row[column] = tags::ToInteger(column, number);
        };
        if (i % 10 == 0) time = 0.0;
        const double probability = uniform(0.001, 1.0);
        row[Column::kTarget] = static_cast<int64_t>(i / 10);
        row[Column::kClass] = 1;
        row[Column::kAction] = static_cast<int64_t>(uniform(0.0, kActions));
        row[Column::kLikeliest] = row[Column::kAction];
        row[Column::kWindows] = 2;
        set(Column::kFrom, time);
        set(Column::kTo, time + 0.5);
        set(Column::kPeak, time);
        set(Column::kResponsibility, uniform(0.0, 1.0));
        set(Column::kProbability, probability);
        set(Column::kSurprise, -std::log(probability));
        set(Column::kAde, uniform(0.0, 5.0));
        set(Column::kFde, uniform(0.0, 12.0));
        set(Column::kSpeed, uniform(0.0, 20.0));
        set(Column::kX, uniform(-5000.0, 5000.0));
        set(Column::kY, uniform(-5000.0, 5000.0));
        set(Column::kHeading, uniform(-3.0, 3.0));
        for (const Column column : {Column::kMidX, Column::kMidY, Column::kEndX, Column::kEndY}) {
          set(column, uniform(-20.0, 80.0));
        }
        time += 1.0;
      }
      const absl::Status status = (*writer)->Add(absl::StrCat("scene-", scene), made);
      if (!status.ok()) return std::cerr << status << "\n", 1;
    }
    if (const absl::Status status = (*writer)->Commit(); !status.ok()) {
      return std::cerr << status << "\n", 1;
    }
  }
  return 0;
}

}  // namespace
}  // namespace maneuver::bench

int main(int argc, char** argv) { return maneuver::bench::Main(argc, argv); }
