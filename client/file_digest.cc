#include "client/file_digest.h"

#include <openssl/evp.h>

#include <array>
#include <fstream>
#include <memory>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace maneuver::client {

namespace {

using DigestContext = std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)>;

DigestContext BeginDigest() {
  DigestContext context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr);
  return context;
}

std::string FinishDigest(EVP_MD_CTX* context) {
  std::array<unsigned char, 32> digest{};
  EVP_DigestFinal_ex(context, digest.data(), nullptr);
  return absl::BytesToHexString(
      absl::string_view(reinterpret_cast<const char*>(digest.data()), digest.size()));
}

}  // namespace

std::string Sha256Of(absl::string_view bytes) {
  const DigestContext context = BeginDigest();
  EVP_DigestUpdate(context.get(), bytes.data(), bytes.size());
  return FinishDigest(context.get());
}

absl::StatusOr<std::string> Sha256OfFile(const std::string& file) {
  std::ifstream bytes(file, std::ios::binary);
  if (!bytes) return absl::NotFoundError(absl::StrCat(file, " cannot be opened"));
  const DigestContext context = BeginDigest();
  std::vector<char> buffer(size_t{1} << 18);
  while (bytes.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) ||
         bytes.gcount() > 0) {
    EVP_DigestUpdate(context.get(), buffer.data(), static_cast<size_t>(bytes.gcount()));
  }
  if (bytes.bad()) return absl::DataLossError(absl::StrCat(file, " cannot be read to its end"));
  return FinishDigest(context.get());
}

}  // namespace maneuver::client
