"""The package against a real server, with a model that it trains there."""

import hashlib
import os
import pathlib
import struct
import subprocess
import tempfile
import threading
import unittest
import warnings

import grpc
import numpy

import maneuver
from maneuver import v1
from server import TINY, Server, trained_server

PLANNER = maneuver.Scenario(
    scenario_id="by-hand", prediction_time=1.0, target_ids=[7],
    agents=[maneuver.Agent(7, length=4.5, width=1.9, states=[
        (0.0, 100.0, 50.0, 0.5, 8.0, 4.0), (0.5, 104.0, 52.0, 0.5, 8.0, 4.0),
        (1.0, 108.0, 54.0, 0.5, 8.0, 4.0)])],
    map_features=[maneuver.MapFeature("lane_centerline", [(90.0, 45.0), (200.0, 100.0)], id=1)])


def in_degrees(scene):
    """Returns the scene as a message whose headings look like degrees."""
    message = scene.to_proto()
    for agent in message.agents:
        for state in agent.states:
            state.heading = 180.0
    return message


class LiveTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.server = trained_server()

    def setUp(self):
        self.client = maneuver.Client(self.server.address, deadline=60.0)
        self.addCleanup(self.client.close)

    def recordings(self, count):
        """Recordings of the town with one vehicle as their target."""
        scenes = []
        for summary in self.client.list_scenarios("datasets/town"):
            scene = self.client.get_scenario("datasets/town", summary.scenario_id)
            vehicles = {agent.id for agent in scene.agents if agent.type == v1.AGENT_TYPE_VEHICLE}
            targets = [target for target in scene.target_ids if target in vehicles][:1]
            if targets:
                scene.target_ids[:] = targets
                scenes.append(scene)
            if len(scenes) == count:
                break
        return scenes


class PredictionTest(LiveTest):

    def test_answers_have_what_the_stubs_get(self):
        scene = self.recordings(1)[0]
        got = self.client.predict(scene, model="models/tiny", top_k=3)
        with grpc.insecure_channel(self.server.address) as channel:
            expected = v1.prediction_service_pb2_grpc.PredictionServiceStub(channel).Predict(
                v1.PredictRequest(model="models/tiny", scenarios=[scene],
                                  query=v1.DistributionQuery(top_k=3)), timeout=60)
        target = expected.predictions[0].targets[0]
        answer = got.target()
        self.assertEqual(got.model_version, "models/tiny/versions/1")
        self.assertEqual(got.predictions[0].scenario_id, scene.scenario_id)
        self.assertEqual(got.waypoint_times.tolist(), list(expected.waypoint_times))
        self.assertEqual(answer.probabilities.tolist(), list(target.probabilities))
        self.assertEqual(answer.action_ids, [one.action_id for one in target.distributions])
        second = target.distributions[1]
        self.assertEqual(answer.mean_trajectories[1, :, 0].tolist(), list(second.mean_trajectory.x))
        self.assertEqual(answer.sigma_trajectories[1, 6, :, 1].tolist(),
                         list(second.sigma_trajectories[6].y))
        self.assertEqual(answer.waypoint_covariances[1, :, 0, 1].tolist(),
                         list(second.moments.covariance_xy))

    def test_answers_have_action_names_on_request(self):
        names = self.client.get_action_set("models/tiny").action_names
        self.assertEqual(len(set(names)), 12)
        asks = (self.client.predict, self.client.predict_action_probabilities,
                self.client.predict_action_distributions)
        for ask in asks:
            self.assertEqual(ask(PLANNER).action_names, [])
            self.assertEqual(ask(PLANNER, include_action_names=True,
                                 required_action_names=names[:2]).action_names, names)
            with self.assertRaises(maneuver.FailedPreconditionError) as caught:
                ask(PLANNER, required_action_names=["fly"])
            self.assertEqual(caught.exception.missing_action_names, ("fly",))

    def test_answers_are_distributions_of_the_stated_shapes(self):
        answer = self.client.predict(PLANNER, min_probability=0.0).target()
        self.assertAlmostEqual(answer.probabilities.sum(), 1.0)
        self.assertEqual(answer.probabilities.shape, (12,))
        self.assertEqual(answer.mean_trajectories.shape, (12, 10, 2))
        self.assertEqual(answer.sigma_trajectories.shape, (12, 7, 10, 2))
        self.assertEqual(answer.waypoint_covariances.shape, (12, 10, 2, 2))
        self.assertEqual(answer.latent_means.shape, (12, 3))
        self.assertTrue((numpy.linalg.eigvalsh(answer.waypoint_covariances) >= 0.0).all())
        self.assertTrue((numpy.diff(answer.action_probabilities) <= 0.0).all())
        numpy.testing.assert_array_equal(answer.probabilities[answer.action_ids],
                                         answer.action_probabilities)

    def test_the_target_frame_is_the_world_frame_turned_and_moved(self):
        world = self.client.predict(PLANNER, top_k=2).target()
        target = self.client.predict(PLANNER, top_k=2, frame="target").target()
        heading, place = 0.5, (108.0, 54.0)
        turn = numpy.array([[numpy.cos(heading), -numpy.sin(heading)],
                            [numpy.sin(heading), numpy.cos(heading)]])
        numpy.testing.assert_allclose(target.mean_trajectories @ turn.T + place,
                                      world.mean_trajectories, atol=1e-4)

    def test_selects_actions_and_parts_of_the_answer(self):
        answer = self.client.predict(PLANNER, action_ids=[4, 2], sigma_trajectories=False,
                                     representatives=2).target()
        self.assertLessEqual({4, 2}, set(answer.action_ids))
        self.assertEqual(answer.sigma_trajectories.shape[1], 0)
        self.assertAlmostEqual(sum(one.weight for one in answer.representatives), 1.0)
        self.assertIsNone(self.client.predict(PLANNER).predictions[0].joint)
        joint = self.client.predict(PLANNER, min_probability=1.0, joint=3)
        found = joint.predictions[0].joint
        self.assertEqual(found.target_ids, [joint.target().target_id])
        self.assertEqual([one.action_ids[0] for one in found.combinations],
                         joint.target().action_ids)
        self.assertAlmostEqual(sum(one.weight for one in found.combinations), 1.0)
        generic = self.client.predict(PLANNER, source="prior", top_k=1, frame="target")
        self.assertEqual(generic.target().mean_trajectories.shape, (1, 10, 2))
        likely = self.client.predict(PLANNER).target()
        self.assertEqual(len(likely.action_ids), (likely.probabilities >= 0.05).sum())

    def test_the_two_questions_alone_agree_with_both_at_once(self):
        both = self.client.predict(PLANNER, top_k=3).target()
        first = self.client.predict_action_probabilities(PLANNER, priority="bulk").target()
        second = self.client.predict_action_distributions(PLANNER, top_k=3).target()
        numpy.testing.assert_allclose(first.probabilities, both.probabilities, atol=1e-6)
        self.assertEqual(len(first.action_ids), 0)
        numpy.testing.assert_allclose(second.mean_trajectories, both.mean_trajectories, atol=1e-4)
        self.assertEqual(len(second.probabilities), 0)

    def test_classifies_what_was_driven(self):
        scene = self.recordings(1)[0]
        answer = self.client.classify_trajectories(scene).target()
        self.assertAlmostEqual(answer.responsibilities.sum(), 1.0)
        self.assertEqual(answer.responsibilities.shape, (12,))
        self.assertTrue(numpy.isfinite(answer.log_likelihood_bound))

    def test_reports_what_really_happened(self):
        scene = self.recordings(1)[0]
        now, target = scene.prediction_time, scene.target_ids[0]
        agent = next(agent for agent in scene.agents if agent.id == target)
        outcome = v1.Outcome(scenario=scene, targets=[v1.TargetOutcome(
            target_id=target, states=[state for state in agent.states if state.time > now + 1e-6])])
        unknown = {"scenarioId": "nowhere", "targets": [{"targetId": 1}]}
        scored, refused = self.client.report_outcomes([outcome, unknown]).scores
        self.assertFalse(scored.targets[0].HasField("error"), scored.targets[0].error.message)
        self.assertGreaterEqual(scored.targets[0].metrics["ade_1"],
                                scored.targets[0].metrics["min_ade_6"])
        self.assertEqual(refused.targets[0].error.code, grpc.StatusCode.NOT_FOUND.value[0])
        with self.assertRaises(maneuver.InvalidArgumentError):
            self.client.report_outcomes([])
        first, none, second = self.client.stream_outcomes([[outcome], [], [outcome, unknown]])
        self.assertEqual(first.scores[0], scored)
        self.assertIsInstance(none, maneuver.InvalidArgumentError)
        self.assertEqual(second.scores[1].targets[0].error.code, grpc.StatusCode.NOT_FOUND.value[0])

    def test_a_wrong_scene_of_a_batch_fails_alone(self):
        wrong = maneuver.Scenario.from_proto(PLANNER.to_proto())
        wrong.agents[0].length = -1.0
        answer = self.client.predict([PLANNER, wrong, PLANNER])
        first, second, third = answer.predictions
        self.assertIsNone(first.error)
        self.assertIsNone(third.error)
        self.assertIsInstance(second.error, maneuver.InvalidArgumentError)
        self.assertEqual(second.error.reason, "INVALID_FIELD")
        self.assertEqual(second.error.violations[0].field, "scenarios[1].agents[0].length")
        with self.assertRaises(maneuver.InvalidArgumentError):
            answer.raise_errors()

    def test_a_scene_that_looks_wrong_is_answered_with_warnings(self):
        degrees = in_degrees(PLANNER)
        with self.assertWarnsRegex(maneuver.DoubtfulSceneWarning,
                                   r"by-hand: scenarios\[1\].agents\[0\].*radians") as shown:
            answer = self.client.predict([PLANNER, degrees])
        self.assertEqual(shown.filename, __file__, "it names the caller's line")
        self.assertEqual(answer.predictions[0].warnings, [])
        warning = answer.predictions[1].warnings[0]
        self.assertEqual(warning.field, "scenarios[1].agents[0].states[2].heading")
        self.assertAlmostEqual(answer.predictions[1].targets[0].probabilities.sum(), 1.0)

    def test_a_strict_call_refuses_a_scene_that_looks_wrong_and_no_other(self):
        degrees = in_degrees(PLANNER)
        asks = (self.client.predict, self.client.predict_action_probabilities,
                self.client.predict_action_distributions)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for ask in asks:
                fine, refused = ask([PLANNER, degrees], strict=True).predictions
                self.assertIsNone(fine.error)
                self.assertEqual(refused.error.reason, "INVALID_FIELD")
                self.assertEqual(refused.error.violations[0].field,
                                 "scenarios[1].agents[0].states[2].heading")

    def test_errors_have_classes_and_reasons(self):
        with self.assertRaises(maneuver.NotFoundError) as raised:
            self.client.predict(PLANNER, model="models/nowhere")
        self.assertEqual(raised.exception.reason, "MODEL_NOT_FOUND")
        with self.assertRaises(maneuver.InvalidArgumentError) as raised:
            self.client.predict(PLANNER, top_k=-1)
        self.assertEqual(raised.exception.violations[0].field, "query.top_k")

    def test_maps_are_held_and_have_the_id_that_the_contract_states(self):
        map_id = self.client.register_map(PLANNER.map_features)
        feature = PLANNER.to_proto().map_features[0]
        expected = struct.pack("<qii5d", feature.id, feature.type, len(feature.x), *feature.x,
                               *feature.y, feature.speed_limit)
        self.assertEqual(map_id, hashlib.sha256(expected).hexdigest())
        by_id = maneuver.Scenario.from_proto(PLANNER.to_proto())
        by_id.map_features, by_id.map_id = (), map_id
        numpy.testing.assert_array_equal(self.client.predict(by_id).target().probabilities,
                                         self.client.predict(PLANNER).target().probabilities)

    def test_map_reuse_answers_as_the_client_does(self):
        maps = maneuver.MapReuse(self.client)
        for scene in self.recordings(2) * 2:
            numpy.testing.assert_array_equal(maps.predict(scene).target().mean_trajectories,
                                             self.client.predict(scene).target().mean_trajectories)

    def test_threads_share_one_client(self):
        expected = self.client.predict(PLANNER).target().probabilities
        answers = []
        threads = [threading.Thread(target=lambda: answers.append(
            self.client.predict(PLANNER).target().probabilities)) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(answers), 8)
        for answer in answers:
            numpy.testing.assert_array_equal(answer, expected)


class StreamTest(LiveTest):

    def test_answers_each_request_by_its_id(self):
        expected = self.client.predict(PLANNER).target().probabilities
        answers = {}
        with self.client.stream_predict(lambda answer: answers.update({answer.request_id: answer})
                                        ) as stream:
            for cycle in range(20):
                stream.send(str(cycle), PLANNER, request_timeout=60.0)
            stream.send("wrong", PLANNER, model="models/nowhere")
        self.assertEqual(set(answers), {*map(str, range(20)), "wrong"})
        self.assertEqual(answers["wrong"].error.reason, "MODEL_NOT_FOUND")
        self.assertIsNone(answers["wrong"].predictions)
        for cycle in range(20):
            numpy.testing.assert_allclose(
                answers[str(cycle)].predictions.target().probabilities, expected, atol=1e-6)

    def test_finish_raises_what_the_callback_raised(self):
        stream = self.client.stream_predict(lambda answer: 1 / 0)
        stream.send("a", PLANNER)
        with self.assertRaises(ZeroDivisionError):
            stream.finish()
        with self.assertRaises(ZeroDivisionError):
            stream.send("b", PLANNER)

    def test_finish_says_that_it_was_cancelled(self):
        stream = self.client.stream_predict(lambda answer: None)
        stream.cancel()
        with self.assertRaises(maneuver.CancelledError):
            stream.finish()

    def test_a_finished_stream_takes_no_more(self):
        with self.client.stream_predict(lambda answer: None) as stream:
            pass
        with self.assertRaisesRegex(ValueError, "finished"):
            stream.send("a", PLANNER)


class ManagementTest(LiveTest):

    def test_an_upload_tells_its_progress(self):
        dataset = self.client.get_dataset("datasets/town")
        total = sum(shard.size_bytes for shard in dataset.shards)
        self.assertEqual(self.server.uploads[0], maneuver.UploadProgress(0, total))
        self.assertEqual(self.server.uploads[-1], maneuver.UploadProgress(total, total))
        with self.assertRaises(maneuver.AlreadyExistsError) as raised:
            self.client.upload_dataset(self.server.folder / "town", "datasets/town")
        self.assertEqual(raised.exception.reason, "DATASET_EXISTS")

    def test_a_folder_that_the_server_does_not_allow_is_not_registered(self):
        with self.assertRaises(maneuver.PermissionDeniedError) as raised:
            self.client.register_dataset("datasets/in-place", str(self.server.folder / "town"))
        self.assertEqual(raised.exception.reason, "FOLDER_NOT_ALLOWED")

    def test_what_the_server_writes_is_nobody_elses(self):
        data = self.server.folder / "data"
        written = list(data.rglob("*"))
        self.assertGreater(len(written), 10)
        for path in written:
            self.assertEqual(path.stat().st_mode & 0o077, 0, path)

    def test_lists_all_pages(self):
        summaries = list(self.client.list_scenarios("datasets/town"))
        self.assertEqual(len({one.scenario_id for one in summaries}), 24)
        self.assertEqual([one.name for one in self.client.list_datasets()], ["datasets/town"])
        self.assertEqual([one.name for one in self.client.list_model_versions()],
                         ["models/tiny/versions/1"])

    def test_describes_a_dataset(self):
        summary = self.client.describe_dataset("datasets/town", examples={"stride": "2s"})
        self.assertEqual(summary.dataset.recordings, 24)
        self.assertEqual(summary.example_settings.stride.seconds, 2)
        self.assertGreater(summary.examples, 0)

    def test_a_job_tells_its_progress_until_it_has_ended(self):
        sequences = [job.progress.sequence for job in self.server.events]
        self.assertEqual(sequences, sorted(sequences))
        self.assertIn("pretrain", {job.progress.phase for job in self.server.events})
        self.assertEqual(self.server.job.state, v1.JOB_STATE_SUCCEEDED)
        self.assertEqual(self.server.job.model_version, "models/tiny/versions/1")
        self.assertTrue(maneuver.has_ended(self.server.job))
        last = list(self.client.watch_job(self.server.job.name, after_sequence=sequences[-1]))
        self.assertEqual(last[-1].model_version, "models/tiny/versions/1")

    def test_waiting_for_a_job_that_was_cancelled_says_so(self):
        # Of more epochs than anyone waits for.
        endless = {**TINY, "optimization": {**TINY["optimization"], "pretraining_epochs": 10000}}
        job = self.client.train("models/tiny", ["datasets/town"], endless)
        self.assertIn(job.name, [one.name for one in self.client.list_jobs()])
        self.client.cancel_job(job.name)
        with self.assertRaises(maneuver.CancelledError):
            self.client.wait_for_job(job, timeout=60.0)
        self.assertEqual(self.client.get_job(job.name).state, v1.JOB_STATE_CANCELLED)
        self.client.delete_job(job.name)
        with self.assertRaises(maneuver.NotFoundError):
            self.client.get_job(job.name)

    def test_settings_are_checked_without_starting(self):
        job = self.client.train("models/tiny", ["datasets/town"], TINY, validate_only=True)
        self.assertEqual(job.name, "")
        with self.assertRaises(maneuver.InvalidArgumentError) as raised:
            self.client.train("models/tiny", ["datasets/town"],
                              {"optimization": {"batch_size": -1}})
        self.assertEqual(raised.exception.violations[0].field, "settings.optimization.batch_size")
        with self.assertRaisesRegex(ValueError, "epoks"):
            self.client.train("models/tiny", ["datasets/town"], {"epoks": 3})

    def test_a_version_moves_to_another_server(self):
        other = Server()
        self.addCleanup(other.close)
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()), "tiny-1")
        self.assertEqual(self.client.download_model_version("models/tiny", folder),
                         "models/tiny/versions/1")
        there = self.server.folder / "data/models/tiny/1"
        for name in ("model.json", "weights.safetensors"):
            self.assertEqual((folder / name).read_bytes(), (there / name).read_bytes())
        with maneuver.Client(other.address, deadline=60.0) as client:
            version = client.upload_model_version(folder, "models/moved")
            self.assertEqual(version.name, "models/moved/versions/1")
            again = client.upload_model_version(folder, "models/moved")
            self.assertEqual(again.name, version.name, "it is there once")
            numpy.testing.assert_array_equal(
                client.predict(PLANNER, model=version.name).target().probabilities,
                self.client.predict(PLANNER).target().probabilities)
            with self.assertRaises(maneuver.NotFoundError):
                client.download_model_version("models/nowhere", folder.parent / "nowhere")
            self.assertFalse((folder.parent / "nowhere").exists())

    def test_tags_recordings_and_brings_the_tags(self):
        job = self.client.wait_for_job(self.client.tag("models/tiny", ["datasets/town"],
                                                       "tags/june", stride=2.0))
        self.assertEqual(job.tagged.shards, 1)
        self.assertEqual([tags.name for tags in self.client.list_tags()], ["tags/june"])
        self.assertEqual(self.client.get_tags("tags/june"), job.tagged)
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()), "june")
        self.assertEqual(self.client.download_tags("tags/june", folder), "tags/june")
        there = self.server.folder / "data/tags/june"
        names = [path.name for path in there.iterdir() if not path.name.startswith(".")]
        self.assertEqual(len(names), 3)
        for name in names:
            self.assertEqual((folder / name).read_bytes(), (there / name).read_bytes())
        self.client.delete_tags("tags/june")
        with self.assertRaises(maneuver.NotFoundError):
            self.client.get_tags("tags/june")

    def test_evaluates_and_keeps_the_report(self):
        job = self.client.wait_for_job(self.client.evaluate("models/tiny", "datasets/town",
                                                            examples={"stride": "4s"}))
        self.assertGreater(job.evaluation.metrics["min_ade_6"], 0.0)
        report = next(self.client.list_evaluation_reports("models/tiny"))
        self.assertEqual(self.client.get_evaluation_report(report.name).metrics,
                         job.evaluation.metrics)

    def test_actions_have_labels_and_shapes(self):
        version = self.client.get_model_version("models/tiny@serving").name
        self.client.label_action(version, 3, "stops")
        actions = self.client.get_action_set("models/tiny")
        self.assertEqual(actions.actions[3].label, "stops")
        self.assertEqual(actions.mean_trajectories.shape, (12, 10, 2))
        self.assertEqual(actions.waypoint_times.shape, (10,))

    def test_aliases_are_set_and_removed(self):
        version = "models/tiny/versions/1"
        self.client.set_model_alias("models/tiny/aliases/candidate", version)
        self.assertIn("candidate", self.client.get_model_version(version).aliases)
        self.client.delete_model_alias("models/tiny/aliases/candidate")
        self.assertNotIn("candidate", self.client.get_model_version(version).aliases)
        with self.assertRaises(maneuver.FailedPreconditionError) as raised:
            self.client.delete_model_version(version)
        self.assertEqual(raised.exception.reason, "MODEL_VERSION_IN_USE")

    def test_asks_for_health_and_log_level(self):
        self.client.check_health()
        self.client.check_health("maneuver.v1.PredictionService")
        with self.assertRaises(maneuver.NotFoundError):
            self.client.check_health("no.such.Service")
        before = self.client.set_log_level(v1.LOG_LEVEL_WARNING)
        self.assertEqual(self.client.get_log_level(), v1.LOG_LEVEL_WARNING)
        self.client.set_log_level(before)


class OtherServersTest(unittest.TestCase):

    def test_predictions_go_to_the_server_that_has_a_model(self):
        empty = Server()
        self.addCleanup(empty.close)
        with maneuver.Client(empty.address) as client:
            with self.assertRaises(maneuver.UnavailableError) as raised:
                client.check_health("maneuver.v1.PredictionService")
            self.assertEqual(raised.exception.reason, "NOT_SERVING")
        with maneuver.Client(f"{empty.address},{trained_server().address}") as client:
            for _ in range(6):
                self.assertEqual(client.predict(PLANNER).model_version, "models/tiny/versions/1")

    def test_calls_and_streams_survive_or_report_a_server_that_dies(self):
        server = Server()
        self.addCleanup(server.close)
        waits = []

        def restart(error, wait):
            if not waits:
                server.start()
            waits.append(wait)

        with maneuver.Client(server.address, retries=20, on_retry=restart) as client:
            client.check_health()
            stream = client.stream_predict(lambda answer: None)
            stream.send("a", PLANNER)
            server.kill()
            with self.assertRaises(maneuver.UnavailableError):
                stream.finish()
            self.assertEqual(list(client.list_model_versions()), [])
        self.assertGreater(len(waits), 0)

    def test_speaks_tls_and_says_who_calls(self):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        key, certificate, tokens = (str(folder / name) for name in ("key", "crt", "tokens"))
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
             "-nodes", "-days", "2", "-subj", "/CN=planner.test", "-addext",
             "subjectAltName=DNS:planner.test", "-keyout", key, "-out", certificate],
            check=True, capture_output=True)
        os.chmod(key, 0o600)
        from server import PROGRAMS
        token = subprocess.run(
            [PROGRAMS / "maneuverd", "token", "create", "--name", "planner", "--roles", "predict",
             "--tokens", tokens], check=True, capture_output=True, text=True).stdout.strip()
        server = Server("--tls-certificate", certificate, "--tls-key", key, "--tokens", tokens)
        self.addCleanup(server.close)
        tls = maneuver.Tls(root_certificates=certificate, server_name="planner.test")
        with maneuver.Client(server.address, tls=tls, token=token) as client:
            self.assertEqual(list(client.list_model_versions()), [])
        with maneuver.Client(server.address, tls=tls) as client:
            with self.assertRaises(maneuver.UnauthenticatedError) as raised:
                list(client.list_model_versions())
            self.assertEqual(raised.exception.reason, "CREDENTIALS_MISSING")
        with maneuver.Client(server.address, tls=tls, token=token) as client:
            with self.assertRaises(maneuver.PermissionDeniedError) as raised:
                client.delete_dataset("datasets/town")
            self.assertEqual(raised.exception.reason, "ROLE_MISSING")


if __name__ == "__main__":
    unittest.main()
