#include "model/artifact/model_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <string>

#include "model/artifact/safetensors.h"
#include "model/files/digest.h"
#include "model/files/sealed_json.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::artifact::model_folder_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string ReadBytes(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void Replace(std::string* text, const std::string& from, const std::string& to) {
  const size_t at = text->find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text->replace(at, from.size(), to);
}

class ModelFolderTest : public testing::Test {
 protected:
  const TemporaryFolder parent_;
  const fs::path folder_ = parent_ / "1";
};

TEST_F(ModelFolderTest, ReadsBackWhatItWrote) {
  StoredModel model = TinyModel();
  (*model.manifest.mutable_metrics())["minADE6"] = 1.25;
  model.manifest.mutable_provenance()->add_datasets("datasets/town");
  ASSERT_TRUE(WriteModelFolder(folder_, model).ok());

  const auto read = ReadModelFolder(folder_);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->manifest.format_version(), 1);
  EXPECT_EQ(read->manifest.weights_sha256(),
            files::Sha256Hex(ReadBytes(folder_ / "weights.safetensors")));
  EXPECT_EQ(read->manifest.spec().SerializeAsString(), TinySpec().SerializeAsString());
  EXPECT_EQ(read->manifest.metrics().at("minADE6"), 1.25);
  EXPECT_EQ(read->manifest.provenance().datasets(0), "datasets/town");
  for (const auto& [name, tensor] : model.weights) {
    EXPECT_EQ(read->weights.at(name).shape, tensor.shape) << name;
    EXPECT_EQ(read->weights.at(name).values, tensor.values) << name;
  }
}

TEST_F(ModelFolderTest, ManifestIsJsonWithProtoFieldNames) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  const std::string json = ReadBytes(folder_ / "model.json");
  EXPECT_THAT(json, HasSubstr("\"meters_per_pixel\": 2"));
  EXPECT_THAT(json, HasSubstr("\"waypoint_interval\": \"0.100s\""));
}

TEST_F(ModelFolderTest, NeverReplacesAVersion) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  EXPECT_EQ(WriteModelFolder(folder_, TinyModel()).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(ReadModelFolder(folder_).ok());
  EXPECT_THAT(parent_.Names(), ElementsAre("1"));
}

TEST_F(ModelFolderTest, RefusesToWriteWhatItWouldNotRead) {
  StoredModel model = TinyModel();
  model.weights["decoder.0.bias"].values[0] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(WriteModelFolder(folder_, model).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(parent_.Names(), IsEmpty());
}

TEST_F(ModelFolderTest, AMissingFolderIsNotFound) {
  EXPECT_EQ(ReadModelFolder(folder_).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(ReadModelManifest(folder_).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(ModelFolderTest, RewritesOnlyTheManifest) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  v1::ModelManifest manifest = ReadModelManifest(folder_).value();
  for (int k = 0; k < 3; ++k) manifest.add_actions()->set_action_id(k);
  manifest.mutable_actions(1)->set_label("turn left");
  manifest.mutable_actions(1)->set_derived_name("left turn, tight");
  manifest.mutable_actions(1)->set_display_name("turn left");
  ASSERT_TRUE(RewriteModelManifest(folder_, manifest).ok());
  const auto read = ReadModelFolder(folder_);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->manifest.actions(1).label(), "turn left");
  EXPECT_EQ(read->manifest.actions(1).derived_name(), "left turn, tight");
  EXPECT_EQ(read->manifest.actions(1).display_name(), "");  // it follows from the others
}

TEST_F(ModelFolderTest, RewritingRefusesTheManifestOfOtherWeights) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  v1::ModelManifest manifest = ReadModelManifest(folder_).value();
  manifest.set_weights_sha256(std::string(64, '0'));
  EXPECT_EQ(RewriteModelManifest(folder_, manifest).code(), absl::StatusCode::kInvalidArgument);
  manifest = ReadModelManifest(folder_).value();
  manifest.mutable_spec()->mutable_trajectory()->set_waypoints(40);
  EXPECT_EQ(RewriteModelManifest(folder_, manifest).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(ReadModelFolder(folder_).ok());
}

TEST_F(ModelFolderTest, DetectsAChangeOfAnyByteOfTheManifest) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  const std::string written = ReadBytes(folder_ / "model.json");
  for (size_t i = 0; i < written.size(); ++i) {
    for (const int mask : {1, 4, 32}) {
      std::string altered = written;
      altered[i] = static_cast<char>(altered[i] ^ mask);
      WriteBytes(folder_ / "model.json", altered);
      ASSERT_EQ(ReadModelManifest(folder_).status().code(), absl::StatusCode::kDataLoss)
          << "byte " << i << ": " << written.substr(i, 20);
    }
  }
}

TEST_F(ModelFolderTest, ReadsAManifestWithoutADigestAndAddsOneWhenRewriting) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  EXPECT_TRUE(HasManifestDigest(folder_));
  WriteBytes(folder_ / "model.json", files::Unseal(ReadBytes(folder_ / "model.json")).value());
  EXPECT_FALSE(HasManifestDigest(folder_));
  const auto read = ReadModelFolder(folder_);
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_TRUE(RewriteModelManifest(folder_, read->manifest).ok());
  EXPECT_TRUE(HasManifestDigest(folder_));
  EXPECT_TRUE(ReadModelFolder(folder_).ok());
}

struct Damage {
  const char* name;
  std::function<void(const fs::path&)> apply;
  const char* reason;
};

class DamagedModelFolderTest : public ModelFolderTest,
                               public testing::WithParamInterface<Damage> {};

TEST_P(DamagedModelFolderTest, IsRefusedWithTheReason) {
  ASSERT_TRUE(WriteModelFolder(folder_, TinyModel()).ok());
  GetParam().apply(folder_);
  const auto read = ReadModelFolder(folder_);
  EXPECT_EQ(read.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(read.status().message()), HasSubstr(GetParam().reason));
}

// Damages the text of a manifest without a digest, as older releases wrote it.
std::function<void(const fs::path&)> InManifest(std::string from, std::string to) {
  return [from, to](const fs::path& folder) {
    std::string json = files::Unseal(ReadBytes(folder / "model.json")).value();
    Replace(&json, from, to);
    WriteBytes(folder / "model.json", json);
  };
}

// Damages the weights and stores a matching digest.
std::function<void(const fs::path&)> InWeights(std::function<void(TensorMap*)> change) {
  return [change](const fs::path& folder) {
    TensorMap weights = ParseSafetensors(ReadBytes(folder / "weights.safetensors")).value();
    change(&weights);
    const std::string bytes = SerializeSafetensors(weights);
    const std::string old_sha256 = ReadModelManifest(folder).value().weights_sha256();
    WriteBytes(folder / "weights.safetensors", bytes);
    InManifest(old_sha256, files::Sha256Hex(bytes))(folder);
  };
}

INSTANTIATE_TEST_SUITE_P(
    All, DamagedModelFolderTest,
    testing::Values(
        Damage{"TruncatedWeights",
               [](const fs::path& folder) {
                 const fs::path file = folder / "weights.safetensors";
                 fs::resize_file(file, fs::file_size(file) - 4);
               },
               "truncated or altered"},
        Damage{"EmptyWeights",
               [](const fs::path& folder) { fs::resize_file(folder / "weights.safetensors", 0); },
               "truncated or altered"},
        Damage{"FlippedBit",
               [](const fs::path& folder) {
                 std::string bytes = ReadBytes(folder / "weights.safetensors");
                 bytes[bytes.size() - 7] ^= 1;
                 WriteBytes(folder / "weights.safetensors", bytes);
               },
               "truncated or altered"},
        Damage{"NoWeights",
               [](const fs::path& folder) { fs::remove(folder / "weights.safetensors"); },
               "weights.safetensors is missing"},
        Damage{"NoManifest", [](const fs::path& folder) { fs::remove(folder / "model.json"); },
               "model.json is missing"},
        Damage{"ManifestIsNotJson",
               [](const fs::path& folder) { WriteBytes(folder / "model.json", "{\"spec\": {,"); },
               "model.json does not parse"},
        Damage{"ManifestIsTruncated",
               [](const fs::path& folder) {
                 fs::resize_file(folder / "model.json", fs::file_size(folder / "model.json") / 2);
               },
               "model.json is truncated or altered"},
        Damage{"AlteredSpecThatStillParses",
               [](const fs::path& folder) {
                 std::string json = ReadBytes(folder / "model.json");
                 Replace(&json, "\"meters_per_pixel\": 2", "\"meters_per_pixel\": 3");
                 WriteBytes(folder / "model.json", json);
               },
               "model.json is truncated or altered"},
        Damage{"UnknownField", InManifest("\"decoder_stddev\"", "\"decoder_deviation\""),
               "model.json does not parse"},
        Damage{"LaterFormat", InManifest("\"format_version\": 1", "\"format_version\": 2"),
               "format version 2"},
        Damage{"BadSpec", InManifest("\"latent_dimensions\": 2", "\"latent_dimensions\": -2"),
               "spec.latent_dimensions"},
        Damage{"SpecOfOtherWeights",
               InManifest("\"latent_dimensions\": 2", "\"latent_dimensions\": 3"), "the spec says"},
        Damage{"AlteredDigest",
               [](const fs::path& folder) {
                 InManifest(ReadModelManifest(folder).value().weights_sha256(),
                            std::string(64, 'a'))(folder);
               },
               "truncated or altered"},
        Damage{"WeightsAreNotSafetensors",
               [](const fs::path& folder) {
                 const std::string bytes = "not safetensors at all";
                 const std::string sha256 = ReadModelManifest(folder).value().weights_sha256();
                 WriteBytes(folder / "weights.safetensors", bytes);
                 InManifest(sha256, files::Sha256Hex(bytes))(folder);
               },
               "weights.safetensors: not a valid safetensors file"},
        Damage{"MissingTensor", InWeights([](TensorMap* w) { w->erase("decoder.1.bias"); }),
               "decoder.1.bias is missing"},
        Damage{"UnknownTensor", InWeights([](TensorMap* w) {
                 (*w)["decoder.7.bias"] = {{1}, {0}};
               }),
               "decoder.7.bias is not part of the spec"},
        Damage{"WrongShape", InWeights([](TensorMap* w) {
                 w->at("trajectory.mean").shape = {2, 3};
               }),
               "trajectory.mean has shape [2, 3], the spec says [3, 2]"},
        Damage{"NotANumber", InWeights([](TensorMap* w) {
                 w->at("mixture.mean").values[1] = std::numeric_limits<float>::quiet_NaN();
               }),
               "mixture.mean holds a value that is not finite"},
        Damage{"Infinite", InWeights([](TensorMap* w) {
                 w->at("backbone.projection.bias").values[0] =
                     std::numeric_limits<float>::infinity();
               }),
               "backbone.projection.bias holds a value that is not finite"},
        Damage{"NegativeVariance", InWeights([](TensorMap* w) {
                 w->at("backbone.normalization.0.running_var").values[0] = -1;
               }),
               "negative variance"},
        Damage{"ZeroDeviation",
               InWeights([](TensorMap* w) { w->at("trajectory.stddev").values[0] = 0; }),
               "not positive"},
        Damage{"IndefiniteCovariance",
               InWeights([](TensorMap* w) { w->at("decoder.covariance").values[1] = 1e6f; }),
               "not positive semi-definite"}),
    [](const testing::TestParamInfo<Damage>& fault) { return fault.param.name; });

}  // namespace
}  // namespace maneuver::artifact::model_folder_test
