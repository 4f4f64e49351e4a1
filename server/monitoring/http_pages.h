// Serves a few pages over HTTP, for probes and scrapers: no TLS, no files, no sessions.

#ifndef MANEUVER_SERVER_MONITORING_HTTP_PAGES_H_
#define MANEUVER_SERVER_MONITORING_HTTP_PAGES_H_

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::monitoring {

struct HttpAnswer {
  int status = 200;
  std::string text;
};

struct HttpPage {
  std::string path;  // "/metrics"
  std::string content_type = "text/plain; charset=utf-8";
  // Makes the answer to one request. Called by several threads at once.
  //   query: what follows '?' in the address; empty without it.
  std::function<HttpAnswer(std::string_view query)> make;
};

// Answers GET and HEAD requests for its pages on its own threads until it is destroyed. Other paths
// give 404, other methods 405.
class HttpPages {
 public:
  //   address: HOST:PORT; port 0 picks a free one.
  // UNAVAILABLE if it cannot listen there.
  static absl::StatusOr<std::unique_ptr<HttpPages>> Serve(const std::string& address,
                                                          std::vector<HttpPage> pages);
  // Ends at once. (The library's listening thread checks only every two seconds whether to end, so
  // the destructor wakes it.)
  virtual ~HttpPages() = default;

  virtual int port() const = 0;
};

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_HTTP_PAGES_H_
