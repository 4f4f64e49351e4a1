"""The rows about what is served and learned: models, jobs, the candidate."""

from panel import curves, query, row


def models():
    return row(
        "Models and swaps",
        curves("Which version serves, and which is the candidate?",
               "Version number in memory, by model and alias; 0: none. Servers that differ show as several lines: promote on each, or "
               "see why one does not load.",
               [query("max by (model, alias, instance) (maneuver_model_version{SERVER}) > 0", "{{model}}@{{alias}} {{instance}}")],
               "none", steps=True, least=0),
        curves("When was a version swapped?",
               "Times that an alias was pointed to another version. Nothing is loaded on the serving path: a latency that "
               "jumps here is the new version's own.",
               [query("sum by (alias) (increase(maneuver_model_swaps_total{SERVER}[RATE]))", "{{alias}}")], "short", least=0),
        curves("How many versions are in memory?", "Serving, candidate and those asked for by number.",
               [query("sum by (instance) (maneuver_models_loaded{SERVER})", "{{instance}}")], "short", steps=True, least=0),
        curves("How long does a version take to load?", "Mean of the last hour, with the warm-up. It is beside the serving path.",
               [query("sum(rate(maneuver_model_load_seconds_sum{SERVER}[1h])) / sum(rate(maneuver_model_load_seconds_count{SERVER}[1h]))",
                      "mean")], "s", width=12, height=6, least=0),
        curves("Did a version not load?",
               'Versions in the last hour. The log line "model refused" says which, and why; what serves goes on.',
               [query("sum by (instance) (increase(maneuver_model_load_failures_total{SERVER}[1h]))", "{{instance}}")], "short",
               width=12, height=6, least=0))


def jobs():
    return row(
        "Jobs and training curves",
        curves("How many jobs run, and how many wait?", "Always some pending: raise --max-running-jobs, or ask for less.",
               [query('sum by (state) (maneuver_jobs{SERVER, state=~"pending|running"})', "{{state}}")], "short", steps=True, least=0),
        curves("How did jobs end?",
               "In the last hour; interrupted ones go on from a checkpoint. Failed: maneuver job show JOB says why, and what to do.",
               [query("sum by (state) (increase(maneuver_job_ends_total{SERVER}[1h]))", "{{state}}"),
                query("sum(increase(maneuver_job_interruptions_total{SERVER}[1h]))", "interrupted")], "short", least=0),
        curves("How far are they?", "Of each job that runs, by slot. Level for long: maneuver job watch JOB.",
               [query("maneuver_job_fraction{SERVER}", "{{instance}} slot {{slot}}")], "percentunit", least=0, most=1),
        curves("Do they still learn?",
               "Loss of the last epoch, nats an example; each phase has its own, so it jumps where one begins. Validation rising while "
               "training falls: it learns by heart; fewer epochs, or more data.",
               [query("maneuver_training_loss_nats{SERVER}", "{{of}}, slot {{slot}}")], "none", width=12, steps=True,
               orders=True),
        curves("How well do they explain what they have not seen?",
               "Log-likelihood of a waypoint on validation examples, nats; higher is better. What two versions of one model "
               "can be compared by.",
               [query("maneuver_training_log_likelihood_nats{SERVER}", "slot {{slot}}")], "none", width=12, steps=True),
        curves("Are the actions in use?", "Effective actions after the last epoch. Falling to a few: they collapse; see docs/explanation/learning.md.",
               [query("maneuver_training_effective_actions{SERVER}", "slot {{slot}}")], "none", width=12, steps=True, least=0),
        curves("How fast do they learn?", "Examples a second. Jobs give way to callers: it falls while those ask for much.",
               [query("maneuver_training_examples_per_second{SERVER}", "slot {{slot}}")], "short", width=12, steps=True, least=0))


def _quantiles(metric):
    return [query(f"histogram_quantile({q}, sum by (model, le) (rate({metric}_bucket{{SERVER}}[30m])))", f"{{{{model}}}} p{q * 100:g}")
            for q in (0.5, 0.95)]


def candidate():
    entropy = ("sum by (model, of) (rate(maneuver_shadow_entropy_nats_sum{SERVER}[30m]))"
               " / sum by (model, of) (rate(maneuver_shadow_entropy_nats_count{SERVER}[30m]))")
    far = "maneuver_shadow_likeliest_trajectory_distance_meters"
    return row(
        "A candidate in the shadow, over the last half hour",
        curves("How far are the candidate's answers from what was answered?",
               "Energy distance of the mixtures of trajectories, metres: 0 only if both say the same. A difference is not a verdict: maneuver "
               "evaluate says which is better. Look half an hour after the alias moved.",
               _quantiles("maneuver_shadow_energy_distance_meters"), "lengthm", width=12, least=0),
        curves("How far are the likeliest trajectories apart?", "Mean trajectories of each version's most probable action, metres.",
               _quantiles(far), "lengthm", width=12, least=0),
        curves("Do they choose the same actions?",
               "Jensen-Shannon divergence of p(y|s), nats, over actions matched by what they do: 0 to 0.69. Telling for a "
               "candidate that was warm-started; for one trained anew the actions are others.",
               _quantiles("maneuver_shadow_divergence_nats"), "none", least=0, most=0.7),
        curves("Is it more decided, or less?", "Mean entropy of p(y|s), nats, of the version that answered and of the candidate.",
               [query(entropy, "{{model}} {{of}}")], "none", least=0),
        curves("How often do they disagree by more than 3 m?", "Share of the targets, by their likeliest trajectories.",
               [query(f'1 - sum by (model) (rate({far}_bucket{{SERVER, le="3"}}[30m])) / sum by (model) (rate({far}_count{{SERVER}}[30m]))',
                      "{{model}}")], "percentunit", least=0, most=1),
        curves("Is the candidate asked at all?",
               "Targets a second. Dropped: no room, so callers come first; lower --shadow-fraction. Failed: do not promote it, "
               "see the log.",
               [query("sum by (outcome) (rate(maneuver_shadow_targets_total{SERVER}[RATE]))", "{{outcome}}")], "short", width=12, least=0),
        curves("What does the shadow cost?", "Share of one core; it rests three times as long as it works, so a quarter at most.",
               [query("sum by (instance) (rate(maneuver_shadow_seconds_total{SERVER}[RATE]))", "{{instance}}")], "percentunit", width=12,
               least=0))


def outcomes():
    def mean(metric, by):
        return f"sum by ({by}) (rate({metric}_sum{{SERVER}}[1h])) / sum by ({by}) (rate({metric}_count{{SERVER}}[1h]))"

    def share(metric, by):
        return (f"sum by (model_version, {by}) (increase({metric}{{SERVER}}[1h])) / on (model_version) group_left ()"
                " sum by (model_version) (increase(maneuver_outcome_scored_total{SERVER}[1h]))")
    return row(
        "What really happened, over the last hour",
        curves("How far off are predictions?",
               "Mean distance from what targets did, metres, on average and at the horizon: of the likeliest action and of the best "
               "of six. Compare with maneuver evaluate on recordings that are like the training's.",
               [query(mean("maneuver_outcome_displacement_meters", "model_version, measure"), "{{model_version}} {{measure}}")],
               "lengthm", least=0),
        curves("At which speeds are they off?", "Mean distance at the horizon, metres, of the best of six, by the target's speed.",
               [query("sum by (model_version, speed) (rate(maneuver_outcome_displacement_meters_sum{SERVER, measure=\"min_fde_6\"}[1h])) / "
                      "sum by (model_version, speed) (rate(maneuver_outcome_displacement_meters_count{SERVER, measure=\"min_fde_6\"}[1h]))",
                      "{{model_version}} {{speed}}")], "lengthm", least=0),
        curves("How unlikely was what happened?",
               "Mean -ln p(x|s), nats a waypoint; lower is better. It rises where the model meets what it has not learned.",
               [query(mean("maneuver_outcome_nll_nats", "model_version"), "{{model_version}}")], "none"),
        curves("Which actions are more probable than in validation, or less?",
               "Difference of the mean p(y|s), by action number: maneuver model actions names them. ManeuverActionsDrift tells what is no "
               "chance: train on recent recordings.",
               [query(share("maneuver_outcome_action_probability_total", "action")
                      + " - max by (model_version, action) (maneuver_outcome_expected_action_ratio{SERVER})",
                      "{{model_version}} action {{action}}")], "percentunit"),
        curves("Do envelopes still hold what happens?",
               "Share of the waypoints within 1 and 2 sigma, and the same in the model's validation. Apart: ManeuverCalibrationLost.",
               [query(share("maneuver_outcome_covered_total", "sigma"), "{{model_version}} {{sigma}} sigma"),
                query("max by (model_version, sigma) (maneuver_outcome_expected_coverage_ratio{SERVER})",
                      "{{model_version}} {{sigma}} sigma, validation")], "percentunit", least=0, most=1),
        curves("Do the probabilities come true?",
               "How far p(y|s) of the likeliest action is from how often it was taken, by its probability in tenths, averaged over the "
               "outcomes: 0 is best. If it stays above that of maneuver evaluate: maneuver recalibrate.",
               [query("sum by (model_version) (abs(sum by (model_version, probability) ("
                      "rate(maneuver_outcome_likeliest_probability_total{SERVER}[1h]) "
                      "- rate(maneuver_outcome_likeliest_responsibility_total{SERVER}[1h])))) "
                      "/ sum by (model_version) (rate(maneuver_outcome_likeliest_total{SERVER}[1h]))",
                      "{{model_version}}")], "percentunit", least=0),
        curves("Does the fleet meet what the model was trained on?",
               "Share of the outcomes whose target is faster or slower than all held-out examples of the training, with more or fewer "
               "agents, or map features within 50 m. Should be near 0: otherwise train on recent recordings.",
               [query(share("maneuver_outcome_outside_training_total", "input"), "{{model_version}} {{input}}")], "percentunit",
               least=0),
        curves("Are outcomes reported and scored?",
               "Targets a second. Unknown: the answer was not kept; report sooner, or raise --outcome-memory. Dropped: answers "
               "that made room for newer ones.",
               [query("sum by (result) (rate(maneuver_outcome_targets_total{SERVER}[RATE]))", "{{result}}"),
                query("sum(rate(maneuver_outcome_dropped_answers_total{SERVER}[RATE]))", "dropped answers")], "short", least=0))


def rows():
    return [models(), jobs(), candidate(), outcomes()]
