// Writes the log lines of gRPC and protobuf to this server's log.

#ifndef MANEUVER_SERVER_RPC_LIBRARY_LOGS_H_
#define MANEUVER_SERVER_RPC_LIBRARY_LOGS_H_

namespace maneuver::rpc {

// Redirects the log lines of gRPC and protobuf from standard error to monitoring::Log. Each becomes
// a line "library message" with the fields library, text and source. Call once, before any thread
// is started.
void LogLibraryLines();

// Returns whether gRPC has given up a port that it listened on. It does so, and says no more than a
// line of the log, after any failure of accept4(): too many open files, or no memory for another.
bool LostListener();

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_LIBRARY_LOGS_H_
