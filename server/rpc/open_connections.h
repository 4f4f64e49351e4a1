// Closes connections of this process, which it finds through the operating system because gRPC does
// not expose them.

#ifndef MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_
#define MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_

namespace maneuver::rpc {

// Shuts down, in both directions, every TCP connection that was accepted on `port`. Both ends then
// see a broken connection.
void CutOffConnections(int port);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_
