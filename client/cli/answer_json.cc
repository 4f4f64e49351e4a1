#include "client/cli/answer_json.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/type_resolver.h>
#include <google/protobuf/util/type_resolver_util.h>

#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"

namespace maneuver::cli {
namespace {

constexpr char kTypes[] = "type.googleapis.com";

// Knows the types of the contract. Details of errors are of types of google.rpc, which are not part
// of this program: those of maneuver.v1 have the same names and fields.
class AnswerTypes final : public google::protobuf::util::TypeResolver {
 public:
  google::protobuf::util::Status ResolveMessageType(const std::string& type_url,
                                                    google::protobuf::Type* type) override {
    return known_->ResolveMessageType(
        absl::StrReplaceAll(type_url, {{"/google.rpc.", "/maneuver.v1."}}), type);
  }
  google::protobuf::util::Status ResolveEnumType(const std::string& type_url,
                                                 google::protobuf::Enum* type) override {
    return known_->ResolveEnumType(type_url, type);
  }

 private:
  const std::unique_ptr<TypeResolver> known_{
      google::protobuf::util::NewTypeResolverForDescriptorPool(
          kTypes, google::protobuf::DescriptorPool::generated_pool())};
};

}  // namespace

absl::StatusOr<std::string> ToAnswerJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  AnswerTypes types;
  std::string json;
  const auto status = google::protobuf::util::BinaryToJsonString(
      &types, absl::StrCat(kTypes, "/", message.GetDescriptor()->full_name()),
      message.SerializeAsString(), &json, options);
  if (!status.ok()) {
    return absl::InternalError(
        absl::StrCat("the answer cannot be written as JSON: ", std::string(status.message())));
  }
  return json;
}

}  // namespace maneuver::cli
