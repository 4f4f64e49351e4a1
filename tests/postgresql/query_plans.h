// How PostgreSQL ran each statement of a store, from the log of a test's own cluster.

#ifndef MANEUVER_TESTS_POSTGRESQL_QUERY_PLANS_H_
#define MANEUVER_TESTS_POSTGRESQL_QUERY_PLANS_H_

#include <filesystem>
#include <string>
#include <vector>

namespace maneuver::postgresql {

struct QueryPlan {
  std::string statement;
  std::string steps;  // as EXPLAIN ANALYZE prints them
};

// Returns the plans of the statements that stores ran, in order, those of foreign keys among them.
std::vector<QueryPlan> ReadPlans(const std::filesystem::path& log);

// Returns whether a statement read a table of jobs, progress, aliases, versions or datasets without
// an index, or read more than 100 rows that it then discarded.
bool ReadsRowsInVain(const QueryPlan& plan);

// Returns whether PostgreSQL compiled code for a statement, which takes longer than any of these.
bool IsCompiled(const QueryPlan& plan);

}  // namespace maneuver::postgresql

#endif  // MANEUVER_TESTS_POSTGRESQL_QUERY_PLANS_H_
