// Lines that gRPC and protobuf log, as lines of this server's log.

#ifndef MANEUVER_SERVER_RPC_LIBRARY_LOGS_H_
#define MANEUVER_SERVER_RPC_LIBRARY_LOGS_H_

namespace maneuver::rpc {

// From now on, what gRPC and protobuf would write on standard error goes through monitoring::Log, in
// its format and by its level: the message "library message" with the fields library, text and
// source. Call once, before any thread is started.
void LogLibraryLines();

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_LIBRARY_LOGS_H_
