// Writes a report with something in each of its parts, for a browser to read:
//   write_report_page FILE

#include <fstream>
#include <iostream>

#include "client/report/report_page.h"
#include "tests/unit/client/report/made_up_report.h"

int main(int argc, char** argv) {
  if (argc != 2) return std::cerr << "usage: write_report_page FILE\n", 2;
  std::ofstream file(argv[1], std::ios::binary);
  file << maneuver::report::ReportPage(maneuver::report::MadeUpReport());
  return file.flush() ? 0 : 1;
}
