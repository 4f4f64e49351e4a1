// The options of maneuverd: by command line, environment and file (configuration.h).

#ifndef MANEUVER_SERVER_MANEUVERD_OPTIONS_H_
#define MANEUVER_SERVER_MANEUVERD_OPTIONS_H_

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "model/data/dataset_store.h"
#include "model/inference/action_model.h"
#include "model/kernels/kernel_choice.h"
#include "server/maneuverd/job_options.h"
#include "server/maneuverd/role.h"
#include "server/monitoring/logging.h"
#include "server/rpc/server.h"
#include "server/security/access_control.h"
#include "server/security/certificates.h"
#include "server/security/listen_address.h"
#include "server/security/resource_name.h"
#include "server/serving/batch_scheduler.h"
#include "server/serving/map_cache.h"
#include "server/serving/send_memory.h"
#include "server/serving/shadow.h"

namespace maneuver {

struct ServerOptions {
  std::filesystem::path data_dir;
  std::string store;       // a URI of PostgreSQL; empty: the embedded store of the data folder
  bool is_shared = false;  // other servers use store and data folder, too
  Role role = Role::kAll;
  std::string replica_name;  // for people, among servers that share
  security::ListenAddress listen;
  std::optional<security::ListenAddress> metrics_listen;  // nothing: no metrics page
  std::filesystem::path port_file;                        // empty: none
  std::vector<security::ModelVersionName> serve;          // to be @serving from the start
  std::optional<security::CertificateFiles> tls;          // nothing: plain text
  security::AccessOptions access;
  rpc::ConnectionLimits limits;
  serving::SchedulerOptions scheduler;
  serving::MapCacheOptions maps;
  serving::SendLimits sends;
  int64_t memory_limit = 0;  // bytes of the whole process; 0: none. The buffers' limits fit into it
  serving::ShadowOptions shadow;
  int64_t outcome_recordings = 0;  // bytes of disk for outcomes that become datasets; 0: none
  int64_t outcome_memory = 0;  // bytes of answers that are kept until their outcomes are reported
  data::DatasetStoreOptions datasets;
  inference::EngineOptions engine;
  kernels::KernelChoice kernels = kernels::KernelChoice::kAuto;
  JobOptions jobs;
  monitoring::LogFormat log_format = monitoring::LogFormat::kText;
  monitoring::LogLevel log_level = monitoring::LogLevel::kInfo;
  // From the signal to stop, when health turns to NOT_SERVING, until new calls are refused.
  std::chrono::milliseconds shutdown_delay{0};
  // From then on, how long calls in flight may take.
  std::chrono::milliseconds shutdown_timeout{10'000};
};

// Returns the options. If the command line is wrong, or asks for help or for the settings, returns
// the exit status instead; the text has then been printed.
//   environment: ends with nullptr, as environ does.
//   needs_data_dir: false for a command that only asks a running server.
std::variant<ServerOptions, int> ParseCommandLine(int argc, const char* const* argv,
                                                  const char* const* environment,
                                                  bool needs_data_dir = true);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_OPTIONS_H_
