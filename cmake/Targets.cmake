# Compiles the sources of a target as one, if `together` and the build say so: in units of sixteen
# sources at most, all of about the same size, so that none is left over to be compiled alone.
function(maneuver_together target together)
  if(together AND MANEUVER_UNITY)
    get_target_property(sources ${target} SOURCES)
    list(FILTER sources INCLUDE REGEX "\\.cc$")
    list(LENGTH sources count)
    math(EXPR units "(${count} + 15) / 16")
    math(EXPR size "(${count} + ${units} - 1) / ${units}")
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${size})
    # A private struct of one source is then in the same unit as another's.
    target_compile_options(${target} PRIVATE "$<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>")
  endif()
endfunction()

# maneuver_library(NAME scene SOURCES a.cc ... DEPENDS ... [TOGETHER])
#
# The one library of a folder, `maneuver_<name>`. DEPENDS are public, PRIVATE
# are seen by its .cc files alone. Without SOURCES it is headers only.
#
# TOGETHER: its sources share heavy headers and are compiled as one, for a faster
# first build; -DMANEUVER_UNITY=OFF compiles each alone, as one wants while editing.
# Their private names must then differ.
function(maneuver_library)
  cmake_parse_arguments(ARG "TOGETHER" "NAME" "SOURCES;DEPENDS;PRIVATE" ${ARGN})
  set(target maneuver_${ARG_NAME})
  if(ARG_SOURCES)
    add_library(${target} STATIC ${ARG_SOURCES})
    target_compile_options(${target} PRIVATE ${MANEUVER_WARNINGS})
    maneuver_together(${target} ${ARG_TOGETHER})
    target_include_directories(${target} PUBLIC "${CMAKE_SOURCE_DIR}")
    target_link_libraries(${target} PUBLIC ${ARG_DEPENDS} PRIVATE ${ARG_PRIVATE})
  else()
    add_library(${target} INTERFACE)
    target_include_directories(${target} INTERFACE "${CMAKE_SOURCE_DIR}")
    target_link_libraries(${target} INTERFACE ${ARG_DEPENDS})
  endif()
endfunction()

# maneuver_program(NAME maneuverd COMPONENT server SOURCES main.cc DEPENDS ... [TOGETHER])
#
# COMPONENT: the part of the installation, and the package, that it belongs to (deploy/packages).
function(maneuver_program)
  cmake_parse_arguments(ARG "TOGETHER" "NAME;COMPONENT" "SOURCES;DEPENDS" ${ARGN})
  add_executable(${ARG_NAME} ${ARG_SOURCES})
  target_compile_options(${ARG_NAME} PRIVATE ${MANEUVER_WARNINGS})
  maneuver_together(${ARG_NAME} ${ARG_TOGETHER})
  target_include_directories(${ARG_NAME} PRIVATE "${CMAKE_SOURCE_DIR}")
  target_compile_definitions(${ARG_NAME} PRIVATE MANEUVER_VERSION="${PROJECT_VERSION}")
  target_link_libraries(${ARG_NAME} PRIVATE ${ARG_DEPENDS})
  install(TARGETS ${ARG_NAME} RUNTIME DESTINATION "${CMAKE_INSTALL_BINDIR}"
    COMPONENT ${ARG_COMPONENT})
endfunction()

# Says how the sources of a test program are compiled: together, and little optimised: their code runs
# once, and -O2 takes half as long again. What they test is compiled as it is shipped.
#
# An x_test.cc is compiled with other tests if it is in a namespace `x_test`. Otherwise it may have
# private names that another has too, and is compiled alone.
function(maneuver_test_program target)
  target_compile_options(${target} PRIVATE ${MANEUVER_WARNINGS} "$<$<CONFIG:Release>:-O1>")
  maneuver_together(${target} TRUE)
  target_include_directories(${target} PRIVATE "${CMAKE_SOURCE_DIR}")
  get_target_property(sources ${target} SOURCES)
  list(FILTER sources INCLUDE REGEX "_test\\.cc$")
  list(LENGTH sources count)
  if(count GREATER 1 AND MANEUVER_UNITY)
    foreach(source IN LISTS sources)
      get_filename_component(name "${source}" NAME_WE)
      file(STRINGS "${source}" own REGEX "^namespace ([a-z0-9_:]+::)?${name} {")
      if(NOT own)
        message(STATUS "${source} of ${target} is compiled alone: it is in no namespace ${name}")
        set_source_files_properties("${source}" PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
      endif()
    endforeach()
  endif()
endfunction()

# Sets `result` to the test suites that sources have.
function(maneuver_suites_of result)
  set(suites "")
  foreach(source IN LISTS ARGN)
    file(STRINGS "${source}" lines REGEX "^(TYPED_)?TEST(_F|_P)?\\(")
    foreach(line IN LISTS lines)
      string(REGEX REPLACE "^[A-Z_]+\\(([A-Za-z0-9_]+).*" "\\1" suite "${line}")
      list(APPEND suites "${suite}")
    endforeach()
  endforeach()
  list(REMOVE_DUPLICATES suites)
  set(${result} "${suites}" PARENT_SCOPE)
endfunction()

# maneuver_test(NAME scene SOURCES a_test.cc ... DEPENDS ... [BY_SUITE])
#
# One program of unit tests, `<name>_test`, for a folder; each case is a ctest. With BY_SUITE each suite
# is one: for a program that takes long to start.
function(maneuver_test)
  cmake_parse_arguments(ARG "BY_SUITE" "NAME;TIMEOUT" "SOURCES;DEPENDS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  set(target ${ARG_NAME}_test)
  add_executable(${target} ${ARG_SOURCES})
  maneuver_test_program(${target})
  target_link_libraries(${target} PRIVATE ${ARG_DEPENDS} GTest::gmock GTest::gtest_main)
  set_target_properties(${target} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/tests")
  if(ARG_BY_SUITE)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${ARG_SOURCES})
    maneuver_suites_of(suites ${ARG_SOURCES})
    foreach(suite IN LISTS suites)
      add_test(NAME ${ARG_NAME}.${suite}
        COMMAND ${target} --gtest_brief=1 "--gtest_filter=${suite}.*:${suite}/*:*/${suite}.*:*/${suite}/*")
      set_tests_properties(${ARG_NAME}.${suite} PROPERTIES TIMEOUT ${ARG_TIMEOUT})
    endforeach()
    return()
  endif()
  include(GoogleTest)
  # A program that is read from the disk anew, LibTorch with it, can take longer than the five seconds
  # that CMake allows.
  gtest_discover_tests(${target} TEST_PREFIX "${ARG_NAME}." DISCOVERY_MODE PRE_TEST NO_PRETTY_VALUES
    DISCOVERY_TIMEOUT 60 PROPERTIES TIMEOUT ${ARG_TIMEOUT})
endfunction()
