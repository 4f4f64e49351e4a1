#include "client/cli/transfer_line.h"

#include <algorithm>
#include <ostream>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/text_format.h"

namespace maneuver::cli {
namespace {

// "12.0 MB of 40 MB, 3.1 MB a second, 9 s left".
std::string HowFar(const client::UploadProgress& progress, double seconds) {
  if (progress.there == progress.total) return "it is being checked";
  const double rate =
      static_cast<double>(progress.there - progress.resumed) / std::max(seconds, 1e-3);
  std::string text = absl::StrCat(Bytes(progress.there), " of ", Bytes(progress.total));
  if (rate > 0.0) {
    const double left = static_cast<double>(progress.total - progress.there) / rate;
    absl::StrAppend(&text, ", ", Bytes(static_cast<int64_t>(rate)), " a second, ", Spell(left),
                    " left");
  }
  return text;
}

}  // namespace

TransferLine::TransferLine(Environment& environment)
    : environment_(environment), line_(environment.errors, environment.progress_form()) {}

client::Client::OnUploaded TransferLine::callback() {
  return [this](const client::UploadProgress& progress) { Show(progress); };
}

int TransferLine::Fail(const absl::Status& error, const std::string& what_is_kept) {
  const int status = environment_.FailCall(error);
  if (has_begun_ && (absl::IsUnavailable(error) || absl::IsDeadlineExceeded(error))) {
    environment_.err << what_is_kept << "; run the same command again to continue\n";
  }
  return status;
}

void TransferLine::Show(const client::UploadProgress& progress) {
  if (!std::exchange(has_begun_, true) && progress.resumed > 0) {
    environment_.err << "resumed: " << Bytes(progress.resumed) << " of " << Bytes(progress.total)
                     << " were there" << std::endl;
  }
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start_;
  line_.Show(static_cast<double>(progress.there) /
                 static_cast<double>(std::max<int64_t>(progress.total, 1)),
             HowFar(progress, passed.count()));
}

}  // namespace maneuver::cli
