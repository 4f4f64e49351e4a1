"""The rows about those who ask: at a glance, traffic, latency, queue, errors."""

from panel import curves, heatmap, number, query, row

_PREDICTIONS = 'method=~"PredictionService/.*", method!~".*/StreamPredict"'
_FAULTS = 'code=~"INTERNAL|UNKNOWN|DATA_LOSS|UNAVAILABLE"'
_TARGETS = "sum(rate(maneuver_targets_total{SERVER}[RATE]))"


def _latency(quantile, selector):
    return (f"histogram_quantile({quantile}, sum by (le) (rate("
            f"maneuver_request_duration_seconds_bucket{{SERVER, {selector}}}[RATE])))")


def _failed(window):
    calls = f"maneuver_requests_total{{SERVER, {_PREDICTIONS}}}"
    failed = f"maneuver_requests_total{{SERVER, {_PREDICTIONS}, {_FAULTS}}}"
    return (f"(sum(rate({failed}[{window}])) or 0 * sum(rate({calls}[{window}])))"
            f" / sum(rate({calls}[{window}]))")


def _slow(window):
    answered = f'SERVER, {_PREDICTIONS}, code="OK"'
    return (f'1 - sum(rate(maneuver_request_duration_seconds_bucket{{{answered}, le="0.25"}}[{window}]))'
            f" / sum(rate(maneuver_request_duration_seconds_count{{{answered}}}[{window}]))")


def at_a_glance():
    return row(
        "At a glance",
        number("Servers that answer", "Fewer than there should be: see ManeuverDown.",
               "sum(up{SERVER})", "none", [(None, "red"), (1, "green")]),
        number("Models that serve, at the least", "0: a server has none, and refuses predictions. See its log for "
               "\"model refused\"; promote a version that loads.",
               "min(maneuver_serving_models{SERVER})", "none", [(None, "red"), (1, "green")]),
        number("Targets answered a second", "Vehicles whose predictions were answered.",
               'sum(rate(maneuver_targets_total{SERVER, outcome="answered"}[RATE]))', "short"),
        number("99 of 100 wait no longer than",
               "Answered calls for predictions. Beyond 0.25 s the budget burns: see Latency by stage.",
               _latency(0.99, _PREDICTIONS + ', code="OK"'), "s",
               [(None, "green"), (0.25, "orange"), (1, "red")]),
        number("Calls failed by the server",
               "INTERNAL, UNKNOWN, DATA_LOSS, UNAVAILABLE. See Errors and refusals, then the log.", _failed("RATE"),
               "percentunit", [(None, "green"), (0.001, "orange"), (0.01, "red")]),
        number("Targets refused or expired",
               "More is asked than can be answered in time: see Batching and queue.",
               'sum(rate(maneuver_targets_total{SERVER, outcome=~"refused|expired"}[RATE]))'
               f" / {_TARGETS}", "percentunit", [(None, "green"), (0.01, "orange"), (0.05, "red")]),
        number("Jobs that run", "What they do: see Jobs and training curves.",
               'sum(maneuver_jobs{SERVER, state="running"})', "none"),
        number("Room on the data disk", "Of the fullest server. Below 5 % uploads and training fail.",
               "min(maneuver_data_disk_free_bytes{SERVER} / maneuver_data_disk_bytes{SERVER})", "percentunit",
               [(None, "red"), (0.05, "orange"), (0.15, "green")]))


def traffic():
    return row(
        "Traffic",
        curves("What is asked, and how often?", "Calls a second by method. A stream is one call, once it has ended.",
               [query('sum by (method) (rate(maneuver_requests_total{SERVER, method!~"Health/.*"}[RATE])) > 0',
                      "{{method}}")], "reqps", least=0),
        curves("What becomes of the targets?",
               "Targets (vehicles) a second. Refused: the queue is full or the deadline too close. Expired and "
               "cancelled: nobody waits any more.",
               [query("sum by (outcome) (rate(maneuver_targets_total{SERVER}[RATE]))", "{{outcome}}")],
               "short", stacked=True, least=0),
        curves("How many calls are being answered?", "Calls in flight. Rising while answers stay level: a queue grows.",
               [query("sum by (method) (maneuver_requests_in_flight{SERVER}) > 0", "{{method}}")], "short", least=0),
        curves("Do all servers get their share?",
               "Targets answered a second, by server. Uneven behind a balancer: gRPC connections are long-lived; balance "
               "calls, or see --max-connection-age.",
               [query('sum by (instance) (rate(maneuver_targets_total{SERVER, outcome="answered"}[RATE]))',
                      "{{instance}}")], "short", least=0),
        curves("How much comes in, and goes out?", "Messages of the contract, bytes a second. Much in: register maps.",
               [query("sum(rate(maneuver_request_bytes_total{SERVER}[RATE]))", "in"),
                query("sum(rate(maneuver_response_bytes_total{SERVER}[RATE]))", "out")], "Bps", least=0),
        curves("How large is a call for predictions?", "Bytes of a request, mean by method. The road is most of it: "
               "registered maps make it some twenty times smaller.",
               [query('sum by (method) (rate(maneuver_request_bytes_total{SERVER, method=~"PredictionService/Predict.*"}[RATE]))'
                      ' / sum by (method) (rate(maneuver_requests_total{SERVER, method=~"PredictionService/Predict.*"}[RATE]))',
                      "{{method}}")], "bytes", least=0))


def latency():
    quantile = ("histogram_quantile({q}, sum by (le, stage) (rate("
                "maneuver_stage_duration_seconds_bucket{{SERVER}}[RATE])))")
    return row(
        "Latency by stage",
        curves("How long do callers wait?",
               "Answered calls for predictions, from the call's start to its status. See the next panels for which stage grew.",
               [query(_latency(q, _PREDICTIONS + ', code="OK"'), f"p{q * 100:g}") for q in (0.5, 0.9, 0.99)],
               "s", least=0, limit=0.25),
        curves("Where does the time go?",
               "Mean seconds: a target in the queue, a batch in each stage. Queue: add capacity. Raster, vectors: large maps; "
               "register them. Encode: the networks, so the model or a busier machine. Describe: more actions are asked for.",
               [query("sum by (stage) (rate(maneuver_stage_duration_seconds_sum{SERVER}[RATE]))"
                      " / sum by (stage) (rate(maneuver_stage_duration_seconds_count{SERVER}[RATE]))", "{{stage}}")],
               "s", stacked=True, least=0),
        curves("Which stage is slow at times?", "99 of 100 take no longer than this, by stage.",
               [query(quantile.format(q=0.99), "{{stage}}")], "s", least=0),
        heatmap("How are the waiting times spread?", "Answered calls for predictions a second, by how long they took. Two bands: "
                "two kinds of calls, or a queue now and then.",
                f'sum by (le) (rate(maneuver_request_duration_seconds_bucket{{SERVER, {_PREDICTIONS}, code="OK"}}[RATE]))', "s"),
        curves("Which methods are slow?", "99 of 100 answered calls take no longer, by method.",
               [query("histogram_quantile(0.99, sum by (le, method) (rate(maneuver_request_duration_seconds_bucket"
                      f'{{SERVER, {_PREDICTIONS}, code="OK"}}[RATE])))', "{{method}}")], "s", least=0),
        curves("Does the latency budget hold?",
               "Share of answered calls that took more than 0.25 s; 1 % may. Above 14 % over an hour somebody is called "
               "(ManeuverSlowFast).",
               [query(_slow("5m"), "5 minutes"), query(_slow("1h"), "1 hour")], "percentunit", least=0, limit=0.01))


def queue():
    return row(
        "Batching and queue",
        curves("How full is the queue?", "Of --max-queue, by priority, of the fullest server. At 100 % callers are told to come later.",
               [query("max by (priority) (maneuver_queue_targets{SERVER} / on (job, instance) group_left () "
                      "maneuver_queue_limit_targets{SERVER})", "{{priority}}")], "percentunit", least=0, limit=0.8),
        curves("How busy are the workers?",
               "Share of their time spent on batches, by server. Near 100 %: what more is asked will wait.",
               [query('sum by (instance) (rate(maneuver_stage_duration_seconds_sum{SERVER, stage!="queue"}[RATE]))'
                      " / sum by (instance) (maneuver_workers{SERVER})", "{{instance}}")], "percentunit", least=0, most=1),
        curves("How many targets share a batch?",
               "Mean. Full batches at --max-batch: there is always something waiting. 1: every call has a worker at once.",
               [query("sum(rate(maneuver_batch_size_sum{SERVER}[RATE])) / sum(rate(maneuver_batch_size_count{SERVER}[RATE]))",
                      "mean")], "short", least=0),
        curves("Was work done that nobody waited for?",
               "Targets dropped a second, by cause and by what they had behind them. Many after the queue: too slow for the callers' "
               "deadlines. Many after encode: the deadlines are a little too short.",
               [query("sum by (cause, after) (rate(maneuver_dropped_targets_total{SERVER}[RATE]))", "{{cause}} after {{after}}")],
               "short", least=0),
        curves("How much memory waits?", "Bytes of the requests that have targets waiting, by priority; --max-queue-bytes is the limit.",
               [query("sum by (priority) (maneuver_queue_bytes{SERVER})", "{{priority}}")], "bytes", least=0),
        curves("Do callers take their answers?",
               "Bytes of answers that are being computed or wait for their callers, of all servers, and --max-send-memory of all. At the "
               "limit calls are refused: some callers read too slowly.",
               [query("sum(maneuver_send_memory_bytes{SERVER})", "answers"),
                query("sum(maneuver_send_memory_limit_bytes{SERVER})", "limit")], "bytes", least=0),
        curves("How near is the limit of the memory?",
               "Memory of each server without pages of files, and --memory-limit, if it has one. From 80 % of it on, calls are refused "
               "with MEMORY_FULL; from 90 % on, the connections that sent the most are closed.",
               [query("maneuver_memory_bytes{SERVER}", "{{instance}}"),
                query("min(maneuver_memory_limit_bytes{SERVER})", "limit")], "bytes", least=0),
        curves("Do the registered maps fit?",
               "Scenarios a second that named a map, and maps let go of. Misses that keep coming: raise --max-maps or --max-map-bytes.",
               [query("sum by (result) (rate(maneuver_map_lookups_total{SERVER}[RATE]))", "{{result}}"),
                query("sum(rate(maneuver_maps_evicted_total{SERVER}[RATE]))", "evicted")], "short", least=0))


def errors():
    return row(
        "Errors and refusals",
        curves("Which calls fail, and how?",
               "Calls a second by code. INVALID_ARGUMENT, NOT_FOUND: callers. RESOURCE_EXHAUSTED: capacity or limits. INTERNAL, "
               "UNKNOWN, DATA_LOSS, UNAVAILABLE: the server; see its log. docs/reference/errors.md has every reason.",
               [query('sum by (code) (rate(maneuver_requests_total{SERVER, code!="OK"}[RATE])) > 0', "{{code}}")],
               "reqps", least=0),
        curves("Which methods fail?", "Calls a second that did not end with OK, by method.",
               [query('sum by (method) (rate(maneuver_requests_total{SERVER, code!="OK"}[RATE])) > 0', "{{method}}")],
               "reqps", least=0),
        curves("Who is not let in, and why?",
               "Calls a second. TOKEN_UNKNOWN: a token was taken back or mistyped. ROLE_MISSING: the caller's line lacks a role. "
               "RATE_LIMITED: one asks more than it may.",
               [query("sum by (reason) (rate(maneuver_refused_calls_total{SERVER}[RATE]))", "{{reason}}")], "reqps", least=0),
        curves("How many calls fail by the server's fault?",
               "Share of the calls for predictions; 0.1 % may. Above 1.4 % over an hour somebody is called (ManeuverFailingFast).",
               [query(_failed("5m"), "5 minutes"), query(_failed("1h"), "1 hour")], "percentunit", width=12, least=0,
               limit=0.001),
        curves("Which share of the targets is refused or expires?", "Refused above 5 %, expired above 1 %: add capacity.",
               [query(f'sum(rate(maneuver_targets_total{{SERVER, outcome="{outcome}"}}[RATE])) / {_TARGETS}', outcome)
                for outcome in ("refused", "expired", "cancelled")], "percentunit", width=12, least=0))


def rows():
    return [at_a_glance(), traffic(), latency(), queue(), errors()]
