// The options of a client and of its calls.

#ifndef MANEUVER_CLIENT_CLIENT_OPTIONS_H_
#define MANEUVER_CLIENT_CLIENT_OPTIONS_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/time/time.h"
#include "client/cancellation.h"
#include "client/retry.h"

namespace maneuver::client {

// How long a call may take if CallOptions do not say.
struct CallDeadlines {
  absl::Duration prediction = absl::Seconds(30);
  absl::Duration management = absl::Seconds(60);  // all other calls but those of the next line
  absl::Duration upload = absl::Hours(1);         // and other calls that read a dataset or version
};

// Encryption and identities. Paths name PEM files.
struct TlsOptions {
  std::string root_certificates = "";  // trusted authorities; empty: the system's
  std::string certificate = "";        // of this client, if the server requires one
  std::string key = "";                // of that certificate
  std::string server_name = "";        // expected in the server's certificate; empty: the address's
};

struct ClientOptions {
  // HOST:PORT, or unix:PATH; HOST alone means port 8470. Several equivalent servers:
  // IP:PORT,IP:PORT, or dns:///NAME:PORT for all addresses of a name. Calls then go to them in
  // turn, predictions only to those whose health says that a model is ready. Calls that change
  // something should name one server. A proxy of the environment (http_proxy) is used only for
  // servers on other machines.
  std::string address = "127.0.0.1:8470";
  std::optional<TlsOptions> tls = {};  // nothing: plain text
  // Identifies the caller to servers that require it. Sent only over TLS or within this machine.
  std::string token = "";
  std::string token_file = "";  // in place of `token`; read by Connect
  CallDeadlines deadlines = {};
  RetryPolicy retry = {};
  // Also retries StartPrediction. gRPC does these retries: with the backoff of `retry`, but at most
  // five attempts, none after many recent failures, and none of requests over 64 MiB.
  bool retry_started = false;
  // When the server rejects more than a sixth of the predictions as too many, or runs out of time
  // for them, the client sends only about a fifth more than the server accepts. That is enough to
  // notice when the server recovers. The client fails the other calls at once with
  // RESOURCE_EXHAUSTED, reason kHeldBack, so that the server's time goes to calls that it can
  // answer.
  bool hold_back = true;
  // An interrupted upload, or stream of outcomes, is retried for this long after the last progress.
  absl::Duration upload_patience = absl::Minutes(2);
  // A watched job whose stream broke is watched again for this long after the last event, or after
  // the end of a stream that the server had accepted.
  absl::Duration watch_patience = absl::Minutes(1);
  OnRetry on_retry = {};        // called before each wait; may be empty
  std::string user_agent = "";  // goes before gRPC's own
  // Gives this client its own connection. By default, clients of the same address share one. A
  // server limits the calls in flight on each connection; further calls wait.
  bool own_connection = false;
};

// Options of one call.
struct CallOptions {
  std::optional<absl::Duration> timeout = {};  // replaces the deadline of CallDeadlines
  Cancellation* cancellation = nullptr;        // not owned; must outlive the call
};

// The progress of an upload or a download, in bytes of files.
struct UploadProgress {
  int64_t there = 0;    // bytes that the receiver has or that are on the way to it
  int64_t total = 0;    // bytes of all files
  int64_t resumed = 0;  // the part of `there` that arrived before this call
};
using OnUploaded = std::function<void(const UploadProgress&)>;

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CLIENT_OPTIONS_H_
