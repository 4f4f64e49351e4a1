"""What jobs did, as a trigger in the database saw it, held against what docs/guides/jobs.md allows."""

import collections

from server_test import check

STATES = ["UNSPECIFIED", "PENDING", "RUNNING", "SUCCEEDED", "FAILED", "CANCELLED"]
ENDED = {"SUCCEEDED", "FAILED", "CANCELLED"}
MOVES = {("", "PENDING"), ("PENDING", "RUNNING"), ("PENDING", "CANCELLED"), ("RUNNING", "SUCCEEDED"),
         ("RUNNING", "FAILED"), ("RUNNING", "CANCELLED"), ("RUNNING", "PENDING")}
RESUMED = {("FAILED", "PENDING"), ("CANCELLED", "PENDING")}
DELETED = {(state, "") for state in ENDED}

# Writers of one job come one after the other, so the moves of each have their order.
_TRIGGERS = """
CREATE TABLE moves (sequence BIGSERIAL PRIMARY KEY, job TEXT, old_state BIGINT, new_state BIGINT, fence BIGINT);
CREATE FUNCTION note_move() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  INSERT INTO moves (job, old_state, new_state, fence) VALUES (
    coalesce(NEW.name, OLD.name), CASE WHEN TG_OP = 'INSERT' THEN NULL ELSE OLD.state END,
    CASE WHEN TG_OP = 'DELETE' THEN NULL ELSE NEW.state END, coalesce(NEW.fence, OLD.fence));
  RETURN NULL; END $$;
CREATE TRIGGER note_insert AFTER INSERT OR DELETE ON jobs FOR EACH ROW EXECUTE FUNCTION note_move();
CREATE TRIGGER note_update AFTER UPDATE ON jobs FOR EACH ROW WHEN (OLD.state <> NEW.state)
  EXECUTE FUNCTION note_move();
"""


def record(cluster):
    done = cluster.sql(_TRIGGERS)
    check(done.returncode == 0, done.stderr)


class Moves:
    """Every move of every job, checked in order."""

    def __init__(self, cluster, allowed, most_running=None):
        self.states = {}  # of the jobs that there are
        self.ends = collections.Counter()  # SUCCEEDED, by job
        self.counts = collections.Counter()
        fences = set()
        for job, old, new, fence in cluster.ask("SELECT job, old_state, new_state, fence FROM moves ORDER BY sequence"):
            before, after = STATES[int(old)] if old else "", STATES[int(new)] if new else ""
            check(self.states.get(job, "") == before, f"{job} moved from {before} and was {self.states.get(job)}")
            check((before, after) in allowed, f"{job} moved from {before or 'nothing'} to {after or 'nothing'}")
            if after == "RUNNING":
                check(fence not in fences, f"{job} got the fence {fence} of another lease")
                fences.add(fence)
            self.counts[before, after] += 1
            self.ends[job] += after == "SUCCEEDED"
            check(self.ends[job] <= 1, f"{job} succeeded twice")
            self.states[job] = after
            if not after:
                del self.states[job]
            running = sum(state == "RUNNING" for state in self.states.values())
            check(most_running is None or running <= most_running, f"{running} jobs run at once")
