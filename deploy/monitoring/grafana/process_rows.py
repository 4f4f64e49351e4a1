"""The row about the process and its machine."""

from panel import curves, number, query, row


def process():
    return row(
        "Process",
        curves("How much processor time does it take?", "Cores, of the server alone; jobs are processes of their own.",
               [query("rate(process_cpu_seconds_total{SERVER}[RATE])", "{{instance}}")], "short", least=0),
        curves("How much memory does it take?", "Resident: models, maps, the queue, and freed memory that is kept for the next burst. Allocated: without "
               "the last. If that grows for hours, the server leaks.",
               [query("process_resident_memory_bytes{SERVER}", "{{instance}} resident"),
                query("maneuver_allocated_bytes{SERVER}", "{{instance}} allocated")], "bytes", least=0),
        curves("How full is the data disk?", "Free, of what holds the data folder. A straight line down to 0: see what grows.",
               [query("maneuver_data_disk_free_bytes{SERVER}", "{{instance}} free")], "bytes", least=0),
        curves("How many descriptors are open?", "Of those allowed. Each connection is one.",
               [query("process_open_fds{SERVER} / process_max_fds{SERVER}", "{{instance}}")], "percentunit", least=0, limit=0.8),
        number("Up for", "The server that started last.", "min(time() - process_start_time_seconds{SERVER})", "s", width=4, height=8),
        number("The certificate is valid for", "The first that ends; new files are taken up without a restart. No data: no TLS.",
               "min(maneuver_tls_certificate_expiry_timestamp_seconds{SERVER} - time())", "s",
               [(None, "red"), (2 * 86400, "orange"), (14 * 86400, "green")], width=4, height=8),
        curves("Which version of the server runs?", "Servers by version. Two lines: an upgrade is under way, or was left halfway.",
               [query("count by (version) (maneuver_build_info{SERVER})", "{{version}}")], "none", steps=True, least=0))


def rows():
    return [process()]
