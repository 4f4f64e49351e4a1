# Copies docs/ to WORK, from where it is installed. A link that leaves docs/ leads nowhere on a machine
# without the source: it becomes its text and, in brackets, the path in the source.
#
#   cmake -DDOCS=docs -DWORK=build/deploy/packages/docs -P install_docs.cmake
#
# tests/docs/check_pages.py --installed holds that every link of the copy leads somewhere.
file(REMOVE_RECURSE "${WORK}")
file(COPY "${DOCS}/" DESTINATION "${WORK}")
file(GLOB_RECURSE pages RELATIVE "${WORK}" "${WORK}/*.md")
foreach(page IN LISTS pages)
  # One ../ for each folder between the page and the root of the source.
  string(REGEX REPLACE "[^/]+" ".." up "${page}")
  string(REPLACE "." "\\." up "${up}")
  file(READ "${WORK}/${page}" text)
  string(REGEX REPLACE "\\[([^]]*)\\]\\(${up}/([^)]*)\\)" "\\1 (`\\2` in the source)" text "${text}")
  file(WRITE "${WORK}/${page}" "${text}")
endforeach()
