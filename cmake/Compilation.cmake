# Language, warnings, instruction set, sanitizers and compiler cache: the same
# for every target.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
# Assertions stay on: they check what cannot go wrong, off the hot loops.
set(CMAKE_CXX_FLAGS_RELEASE "-O2")

if(MANEUVER_PORTABLE)
  add_compile_options(-march=x86-64-v3)
  # Without these, GCC clears objects of 128 bytes by `rep stos` instead of by four stores. Parsing a
  # scene then takes 1.14 times as long.
  if(CMAKE_CXX_COMPILER_ID STREQUAL GNU AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 12)
    add_compile_options(-mmove-max=256 -mstore-max=256)
  endif()
else()
  add_compile_options(-march=native)
endif()
# The same source gives the same bits at every optimisation of the same machine:
# no fused multiply-add where none was written.
add_compile_options(-ffp-contract=off)

# What is shipped is what is measured: every build has the same hardening, and all of it is cheap.
# Stack protector; checked buffer functions (they need an optimised build); landing pads for indirect
# branches and shadow stacks (CET); addresses chosen at each start (PIE); relocations that are all
# resolved, and then read-only, before main (full RELRO). Sanitizers bring checks of their own.
# Debian 12's Scrt1.o and crti.o are not marked for CET. So the linker leaves out the IBT and SHSTK note
# (readelf -n), and the loader does not turn CET on. -z force-ibt would mark code that has no landing pads.
if(NOT MANEUVER_SANITIZER)
  add_compile_options(-fstack-protector-strong -fcf-protection=full -fPIE)
  add_compile_definitions("$<$<NOT:$<CONFIG:Debug>>:_FORTIFY_SOURCE=2>")
  add_link_options("$<$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>:-pie>"
    LINKER:-z,relro,-z,now,-z,noexecstack)
endif()

if(MANEUVER_SANITIZER)
  add_compile_options(-fsanitize=${MANEUVER_SANITIZER} -fno-sanitize-recover=all
    -fno-omit-frame-pointer -g1)
  add_link_options(-fsanitize=${MANEUVER_SANITIZER})
endif()

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # Paths below the source folder count as relative, so that a clone in another folder compiles
  # nothing again.
  set(CMAKE_CXX_COMPILER_LAUNCHER "${CMAKE_COMMAND}" -E env "CCACHE_BASEDIR=${CMAKE_SOURCE_DIR}"
    CCACHE_NOHASHDIR=true "${CCACHE_PROGRAM}")
endif()
find_program(LLD_PROGRAM ld.lld)
if(LLD_PROGRAM)
  add_link_options(-fuse-ld=lld)
endif()

# Warnings for code of ours; generated code is left alone.
set(MANEUVER_WARNINGS -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Werror)
# GCC 12 takes the undefined registers in its own AVX-512 header for uninitialised variables of ours
# (GCC's bug 105593, mended in 13).
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  list(APPEND MANEUVER_WARNINGS -Wno-uninitialized -Wno-maybe-uninitialized)
endif()
# Clang, which the preset `asan` takes, warns of more than GCC does: the errors are GCC's.
if(CMAKE_CXX_COMPILER_ID STREQUAL Clang)
  list(REMOVE_ITEM MANEUVER_WARNINGS -Wshadow -Werror)
endif()
