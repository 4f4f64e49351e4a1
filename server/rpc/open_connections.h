// The connections of this process, as the operating system knows them: gRPC does not give them out.

#ifndef MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_
#define MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_

namespace maneuver::rpc {

// Shuts down, both ways, every TCP connection of this process that came in by `port`. Whoever uses
// one finds it broken.
void CutOffConnections(int port);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_
