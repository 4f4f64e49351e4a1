#include "client/file_digest.h"

#include <openssl/evp.h>

#include <array>
#include <fstream>
#include <memory>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace maneuver::client {

absl::StatusOr<std::string> Sha256OfFile(const std::string& file) {
  std::ifstream bytes(file, std::ios::binary);
  if (!bytes) return absl::NotFoundError(absl::StrCat(file, " cannot be opened"));
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(),
                                                                        EVP_MD_CTX_free);
  EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr);
  std::vector<char> buffer(size_t{1} << 18);
  while (bytes.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) ||
         bytes.gcount() > 0) {
    EVP_DigestUpdate(context.get(), buffer.data(), static_cast<size_t>(bytes.gcount()));
  }
  if (bytes.bad()) return absl::DataLossError(absl::StrCat(file, " cannot be read to its end"));
  std::array<unsigned char, 32> digest{};
  EVP_DigestFinal_ex(context.get(), digest.data(), nullptr);
  return absl::BytesToHexString(
      absl::string_view(reinterpret_cast<const char*>(digest.data()), digest.size()));
}

}  // namespace maneuver::client
