// PostgreSQL's client library, loaded when a store needs it: a server with the embedded store
// neither needs nor loads libpq.so.5. Private to the stores.

#ifndef MANEUVER_SERVER_STORE_LIBPQ_H_
#define MANEUVER_SERVER_STORE_LIBPQ_H_

#include <libpq-fe.h>

#include "absl/status/statusor.h"

namespace maneuver::store {

// The functions that we call, under their own names.
struct Libpq {
#define MANEUVER_LIBPQ_FUNCTIONS(declare)                                                          \
  declare(PQconninfoParse) declare(PQconninfoFree) declare(PQfreemem) declare(PQconnectdbParams)   \
      declare(PQfinish) declare(PQstatus) declare(PQerrorMessage) declare(PQsetnonblocking)        \
          declare(PQsetNoticeReceiver) declare(PQsocket) declare(PQsendQuery)                      \
              declare(PQsendQueryParams) declare(PQflush) declare(PQconsumeInput)                  \
                  declare(PQisBusy) declare(PQgetResult) declare(PQclear) declare(PQresultStatus)  \
                      declare(PQresultErrorMessage) declare(PQresultErrorField) declare(PQntuples) \
                          declare(PQcmdTuples) declare(PQgetvalue) declare(PQgetlength)            \
                              declare(PQgetisnull) declare(PQnotifies)
#define MANEUVER_DECLARE(function) decltype(&::function) function = nullptr;
  MANEUVER_LIBPQ_FUNCTIONS(MANEUVER_DECLARE)
#undef MANEUVER_DECLARE
};

// Loads the library on the first call. It stays loaded. FAILED_PRECONDITION if it is not installed.
absl::StatusOr<const Libpq*> LoadLibpq();

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_LIBPQ_H_
