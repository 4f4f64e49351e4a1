// The parts of protobuf's internals that this server uses: tags, skipping fields, and the check
// that text is UTF-8. protobuf does not guarantee them. So no other file names them, and an
// untested version of protobuf does not compile.

#ifndef MANEUVER_SERVER_RPC_PROTOBUF_INTERNALS_H_
#define MANEUVER_SERVER_RPC_PROTOBUF_INTERNALS_H_

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/stubs/common.h>
#include <google/protobuf/wire_format_lite.h>

#include <cstdint>
#include <string_view>

namespace maneuver::rpc {

static_assert(GOOGLE_PROTOBUF_VERSION / 1000 == 3021,
              "compare server/rpc/protobuf_internals.h with this version of protobuf");

// Returns the tag of a field of bytes, text, a message or packed numbers.
constexpr uint32_t TagOf(int field) {
  using Wire = google::protobuf::internal::WireFormatLite;
  return Wire::MakeTag(field, Wire::WIRETYPE_LENGTH_DELIMITED);
}

// Returns the tag of a field of one integer.
constexpr uint32_t NumberTagOf(int field) {
  using Wire = google::protobuf::internal::WireFormatLite;
  return Wire::MakeTag(field, Wire::WIRETYPE_VARINT);
}

// Skips the content of a field whose tag has been read. Returns false if the content is truncated.
inline bool SkipField(google::protobuf::io::CodedInputStream& input, uint32_t tag) {
  return google::protobuf::internal::WireFormatLite::SkipField(&input, tag);
}

// Returns whether protobuf's parser accepts the text as a string.
inline bool IsUtf8(std::string_view text) {
  return google::protobuf::internal::IsStructurallyValidUTF8(text.data(),
                                                             static_cast<int>(text.size()));
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PROTOBUF_INTERNALS_H_
