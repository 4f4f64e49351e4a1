#include "model/files/digest.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <limits>
#include <vector>

#include "model/files/errno_status.h"

namespace maneuver::files {

struct Sha256::State {
  struct Free {
    void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
  };
  std::unique_ptr<EVP_MD_CTX, Free> context{EVP_MD_CTX_new()};
};

Sha256::Sha256() : state_(std::make_unique<State>()) {
  EVP_DigestInit_ex(state_->context.get(), EVP_sha256(), nullptr);
}

Sha256::~Sha256() = default;

void Sha256::Update(std::string_view bytes) {
  EVP_DigestUpdate(state_->context.get(), bytes.data(), bytes.size());
}

absl::Status Sha256::UpdateWithFile(const std::filesystem::path& file, int64_t bytes) {
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return ErrnoStatus(errno, "open", file);
  std::vector<char> buffer(1 << 18);
  while (bytes > 0) {
    const auto wanted = std::min<int64_t>(bytes, static_cast<int64_t>(buffer.size()));
    const ssize_t count = read(descriptor, buffer.data(), static_cast<size_t>(wanted));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      const int error = errno;
      close(descriptor);
      return ErrnoStatus(error, "read", file);
    }
    if (count == 0) break;
    Update({buffer.data(), static_cast<size_t>(count)});
    bytes -= count;
  }
  close(descriptor);
  return absl::OkStatus();
}

std::string Sha256::Finish() {
  std::array<unsigned char, 32> digest{};
  EVP_DigestFinal_ex(state_->context.get(), digest.data(), nullptr);
  constexpr char kDigits[] = "0123456789abcdef";
  std::string hexadecimal;
  hexadecimal.reserve(2 * digest.size());
  for (const unsigned char byte : digest) {
    hexadecimal.push_back(kDigits[byte >> 4]);
    hexadecimal.push_back(kDigits[byte & 15]);
  }
  return hexadecimal;
}

std::string Sha256Hex(std::string_view bytes) {
  Sha256 sha256;
  sha256.Update(bytes);
  return sha256.Finish();
}

bool IsSha256Hex(std::string_view text) {
  constexpr size_t kDigits = 64;
  return text.size() == kDigits && std::ranges::all_of(text, [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

absl::StatusOr<std::string> Sha256OfFile(const std::filesystem::path& file) {
  Sha256 sha256;
  const absl::Status status = sha256.UpdateWithFile(file, std::numeric_limits<int64_t>::max());
  if (!status.ok()) return status;
  return sha256.Finish();
}

}  // namespace maneuver::files
