#include "tests/fuzz/mutation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "model/data/stable_hash.h"

namespace maneuver::fuzz {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

// A message has at most so many parts that are considered.
constexpr size_t kMostParts = 2000;

void Collect(Message* message, std::vector<Message*>* parts) {
  if (parts->size() >= kMostParts) return;
  parts->push_back(message);
  const Reflection* const reflection = message->GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection->ListFields(*message, &fields);
  for (const FieldDescriptor* field : fields) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (!field->is_repeated()) {
      Collect(reflection->MutableMessage(message, field), parts);
      continue;
    }
    for (int i = 0; i < reflection->FieldSize(*message, field); ++i) {
      Collect(reflection->MutableRepeatedMessage(message, field, i), parts);
    }
  }
}

double MutateNumber(Random& random, double value) {
  static constexpr std::array<double, 24> kSpecial = {0.0,
                                                      -0.0,
                                                      1.0,
                                                      -1.0,
                                                      0.5,
                                                      1e-3,
                                                      1e-300,
                                                      -1e-40,
                                                      5e-324,
                                                      1e8,
                                                      -1e8,
                                                      1.0000001e8,
                                                      1000.0,
                                                      -1000.0,
                                                      1001.0,
                                                      1e11,
                                                      1.7e9,
                                                      3.4028235e38,
                                                      -3.4028235e38,
                                                      1.7976931348623157e308,
                                                      std::numeric_limits<double>::infinity(),
                                                      -std::numeric_limits<double>::infinity(),
                                                      std::numeric_limits<double>::quiet_NaN(),
                                                      3.14159265358979};
  switch (random.Below(6)) {
    case 0:
      return kSpecial[random.Below(kSpecial.size())];
    case 1:
      return -value;
    case 2:
      return value * (random.OneIn(2) ? 10.0 : 0.1);
    case 3:
      return std::nextafter(value, random.OneIn(2) ? 1e300 : -1e300);
    case 4:
      return value + (static_cast<double>(random.Below(2001)) - 1000.0) * 0.01;
    default:
      return value + (static_cast<double>(random.Below(2001)) - 1000.0);
  }
}

int64_t MutateInteger(Random& random, int64_t value) {
  static constexpr std::array<int64_t, 14> kSpecial = {0,
                                                       1,
                                                       -1,
                                                       2,
                                                       127,
                                                       128,
                                                       255,
                                                       1000,
                                                       65535,
                                                       1 << 20,
                                                       std::numeric_limits<int32_t>::max(),
                                                       std::numeric_limits<int32_t>::min(),
                                                       std::numeric_limits<int64_t>::max(),
                                                       std::numeric_limits<int64_t>::min()};
  if (random.OneIn(2)) return kSpecial[random.Below(kSpecial.size())];
  return static_cast<int64_t>(static_cast<uint64_t>(value) + random.Below(17) - 8);
}

// Changes element `index` of a field; index -1 for one that is not repeated, and the number of its
// elements for a new one.
void MutateField(Random& random, Message* message, const FieldDescriptor* field, int index) {
  const Reflection* const r = message->GetReflection();
  const bool repeated = field->is_repeated();
  const bool adds = repeated && index == r->FieldSize(*message, field);
  // Another element's value is a good start.
  const int from =
      adds ? (index > 0 ? static_cast<int>(random.Below(static_cast<uint64_t>(index))) : -1)
           : index;
  const bool has = !repeated || from >= 0;
#define MANEUVER_CASE(CPPTYPE, Name, Type, change)                             \
  case FieldDescriptor::CPPTYPE: {                                             \
    using Value = Type;                                                        \
    const Value old = !has       ? Value{}                                     \
                      : repeated ? r->GetRepeated##Name(*message, field, from) \
                                 : r->Get##Name(*message, field);              \
    const Value now = static_cast<Value>(change);                              \
    if (adds) {                                                                \
      r->Add##Name(message, field, now);                                       \
    } else if (repeated) {                                                     \
      r->SetRepeated##Name(message, field, index, now);                        \
    } else {                                                                   \
      r->Set##Name(message, field, now);                                       \
    }                                                                          \
    break;                                                                     \
  }
  switch (field->cpp_type()) {
    MANEUVER_CASE(CPPTYPE_INT32, Int32, int32_t, MutateInteger(random, old))
    MANEUVER_CASE(CPPTYPE_INT64, Int64, int64_t, MutateInteger(random, old))
    MANEUVER_CASE(CPPTYPE_UINT32, UInt32, uint32_t, MutateInteger(random, old))
    MANEUVER_CASE(CPPTYPE_UINT64, UInt64, uint64_t,
                  MutateInteger(random, static_cast<int64_t>(old)))
    MANEUVER_CASE(CPPTYPE_DOUBLE, Double, double, MutateNumber(random, old))
    case FieldDescriptor::CPPTYPE_FLOAT: {
      const float old = !has       ? 0.0f
                        : repeated ? r->GetRepeatedFloat(*message, field, from)
                                   : r->GetFloat(*message, field);
      const double wide = MutateNumber(random, old);
      // A double beyond the floats has no float: infinity stands for it.
      const float now = std::abs(wide) > std::numeric_limits<float>::max()
                            ? std::copysign(std::numeric_limits<float>::infinity(),
                                            static_cast<float>(wide > 0 ? 1 : -1))
                            : static_cast<float>(wide);
      if (adds) {
        r->AddFloat(message, field, now);
      } else if (repeated) {
        r->SetRepeatedFloat(message, field, index, now);
      } else {
        r->SetFloat(message, field, now);
      }
      break;
    }
      MANEUVER_CASE(CPPTYPE_BOOL, Bool, bool, !old)
    case FieldDescriptor::CPPTYPE_ENUM: {
      const int value = random.OneIn(4) ? static_cast<int>(MutateInteger(random, 0))
                                        : static_cast<int>(random.Below(static_cast<uint64_t>(
                                              field->enum_type()->value_count() + 1)));
      // proto2 keeps no unknown values.
      const bool known = field->enum_type()->FindValueByNumber(value) != nullptr;
      const int kept =
          known || field->file()->syntax() == google::protobuf::FileDescriptor::SYNTAX_PROTO3
              ? value
              : field->enum_type()->value(0)->number();
      if (adds) {
        r->AddEnumValue(message, field, kept);
      } else if (repeated) {
        r->SetRepeatedEnumValue(message, field, index, kept);
      } else {
        r->SetEnumValue(message, field, kept);
      }
      break;
    }
    case FieldDescriptor::CPPTYPE_STRING: {
      std::string text = !has       ? std::string()
                         : repeated ? r->GetRepeatedString(*message, field, from)
                                    : r->GetString(*message, field);
      MutateBytes(random, &text);
      if (adds) {
        r->AddString(message, field, text);
      } else if (repeated) {
        r->SetRepeatedString(message, field, index, text);
      } else {
        r->SetString(message, field, text);
      }
      break;
    }
    case FieldDescriptor::CPPTYPE_MESSAGE:
      if (adds) {
        Message* const added = r->AddMessage(message, field);
        if (from >= 0) added->CopyFrom(r->GetRepeatedMessage(*message, field, from));
      } else if (!repeated) {
        r->MutableMessage(message, field);
      }
      break;
  }
#undef MANEUVER_CASE
}

}  // namespace

uint64_t Random::Next() {
  const uint64_t next = data::SplitMix64(state_);
  state_ += data::kSplitMixStep;
  return next;
}

uint64_t Random::Below(uint64_t count) { return count == 0 ? 0 : Next() % count; }

void MutateBytes(Random& random, std::string* bytes) {
  static constexpr char kOften[] = "0123456789\0\n\r\t ,.:;/\\\"'{}[]()<>=-+#@_\x7f\x80\xff";
  const auto any = [&] {
    return random.OneIn(3) ? static_cast<char>(random.Next())
                           : kOften[random.Below(sizeof(kOften) - 1)];
  };
  const size_t size = bytes->size();
  const size_t at = random.Below(size + 1);
  if (size == 0) {
    bytes->assign(1 + random.Below(8), any());
    return;
  }
  const size_t length = 1 + random.Below(std::min<size_t>(size - std::min(at, size - 1), 32));
  switch (random.Below(8)) {
    case 0:
      (*bytes)[std::min(at, size - 1)] ^= static_cast<char>(1u << random.Below(8));
      break;
    case 1:
      (*bytes)[std::min(at, size - 1)] = any();
      break;
    case 2:
      bytes->insert(at, 1 + random.Below(4), any());
      break;
    case 3:
      bytes->erase(std::min(at, size - 1), length);
      break;
    case 4:
      bytes->insert(random.Below(size + 1), bytes->substr(std::min(at, size - 1), length));
      break;
    case 5:
      bytes->resize(at);
      break;
    case 6: {  // a number of four bytes, as lengths and sizes are
      const uint32_t number = static_cast<uint32_t>(MutateInteger(random, 0));
      for (size_t i = 0; i < 4 && at + i < size; ++i) {
        (*bytes)[at + i] = static_cast<char>(number >> (8 * i));
      }
      break;
    }
    default:
      std::swap((*bytes)[std::min(at, size - 1)], (*bytes)[random.Below(size)]);
      break;
  }
}

void MutateMessage(Random& random, Message* message) {
  std::vector<Message*> parts;
  Collect(message, &parts);
  Message* const part = parts[random.Below(parts.size())];
  const Descriptor* const type = part->GetDescriptor();
  if (type->field_count() == 0) return;
  const FieldDescriptor* const field =
      type->field(static_cast<int>(random.Below(static_cast<uint64_t>(type->field_count()))));
  const Reflection* const reflection = part->GetReflection();
  if (random.OneIn(16)) {
    reflection->ClearField(part, field);
    return;
  }
  if (!field->is_repeated()) {
    MutateField(random, part, field, -1);
    return;
  }
  const int size = reflection->FieldSize(*part, field);
  const int index = static_cast<int>(random.Below(static_cast<uint64_t>(size)));
  switch (random.Below(6)) {
    case 0:
      MutateField(random, part, field, size);
      break;
    case 1:
      if (size > 0) {
        reflection->SwapElements(part, field, index, size - 1);
        reflection->RemoveLast(part, field);
      }
      break;
    case 2:
      if (size > 0) {
        reflection->SwapElements(part, field, index,
                                 static_cast<int>(random.Below(static_cast<uint64_t>(size))));
      }
      break;
    default:
      MutateField(random, part, field, size > 0 ? index : size);
      break;
  }
}

}  // namespace maneuver::fuzz
