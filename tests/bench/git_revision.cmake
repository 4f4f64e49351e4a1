# cmake -DSOURCE=... -DOUTPUT=... -DBUILD_TYPE=... -DCOMPILER=... -P git_revision.cmake
#
# Writes a header with what was built, if it has changed.
execute_process(COMMAND git -C "${SOURCE}" describe --always --dirty --abbrev=10
  OUTPUT_VARIABLE revision OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed)
  set(revision "unknown revision")
endif()
set(text "// What was built.

#ifndef MANEUVER_GIT_REVISION_H_
#define MANEUVER_GIT_REVISION_H_

namespace maneuver::bench {

inline constexpr char kGitRevision[] = \"${revision}\";
inline constexpr char kBuildType[] = \"${BUILD_TYPE}\";
inline constexpr char kCompiler[] = \"${COMPILER}\";

}  // namespace maneuver::bench

#endif  // MANEUVER_GIT_REVISION_H_
")
if(EXISTS "${OUTPUT}")
  file(READ "${OUTPUT}" before)
endif()
if(NOT "${before}" STREQUAL "${text}")
  file(WRITE "${OUTPUT}" "${text}")
endif()
