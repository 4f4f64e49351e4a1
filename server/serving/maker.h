// Who makes a version or moves an alias.

#ifndef MANEUVER_SERVER_SERVING_MAKER_H_
#define MANEUVER_SERVER_SERVING_MAKER_H_

#include <cstdint>
#include <string>

namespace maneuver::serving {

struct Maker {
  std::string name;  // jobs/{job} or uploads/{digest}; empty: unknown
  // The fence of the job's lease. A store refuses the change once that lease has ended. 0: the maker
  // has no lease.
  int64_t fence = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_MAKER_H_
