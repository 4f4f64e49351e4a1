// Writes protobuf's wire format by hand: messages with any field numbers, without a schema.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_WIRE_FORMAT_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_WIRE_FORMAT_H_

#include <cstdint>
#include <cstring>
#include <string>

namespace maneuver::data {

class Wire {
 public:
  Wire& Varint(int field, int64_t value) {
    Tag(field, 0);
    AppendVarint(static_cast<uint64_t>(value));
    return *this;
  }
  Wire& Double(int field, double value) {
    Tag(field, 1);
    return Raw(&value, sizeof value);
  }
  Wire& Float(int field, float value) {
    Tag(field, 5);
    return Raw(&value, sizeof value);
  }
  Wire& Bytes(int field, const std::string& value) {
    Tag(field, 2);
    AppendVarint(value.size());
    bytes_ += value;
    return *this;
  }
  Wire& Message(int field, const Wire& message) { return Bytes(field, message.bytes_); }

  const std::string& bytes() const { return bytes_; }

 private:
  void Tag(int field, int type) { AppendVarint(static_cast<uint64_t>(field) << 3 | type); }
  void AppendVarint(uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<char>(value | 0x80));
    bytes_.push_back(static_cast<char>(value));
  }
  Wire& Raw(const void* value, size_t size) {
    bytes_.append(static_cast<const char*>(value), size);
    return *this;
  }

  std::string bytes_;
};

}  // namespace maneuver::data

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_WIRE_FORMAT_H_
