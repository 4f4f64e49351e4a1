// Shows the progress of an upload or a download on one line of a terminal.

#ifndef MANEUVER_CLIENT_CLI_TRANSFER_LINE_H_
#define MANEUVER_CLIENT_CLI_TRANSFER_LINE_H_

#include <chrono>
#include <string>

#include "absl/status/status.h"
#include "client/cli/environment.h"
#include "client/cli/progress_line.h"
#include "client/client.h"

namespace maneuver::cli {

class TransferLine {
 public:
  explicit TransferLine(Environment& environment);

  // Returns the callback for Client::UploadDataset and other transfers. Its first call says how
  // much was there before.
  client::Client::OnUploaded callback();
  void Clear() { line_.Clear(); }
  // Prints why the transfer failed, after Clear. If the same command can continue it, prints
  // `what_is_kept` and that. Returns kFailed.
  int Fail(const absl::Status& error, const std::string& what_is_kept = "what has arrived is kept");

 private:
  void Show(const client::UploadProgress& progress);

  Environment& environment_;
  ProgressLine line_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  bool has_begun_ = false;  // the callback has been called
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TRANSFER_LINE_H_
