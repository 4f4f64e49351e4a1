#!/usr/bin/python3
"""What can be said of deploy/kubernetes without a cluster: each overlay is rendered, and its parts fit one another.

Needs kubectl (Debian: kubernetes-client) and python3-yaml. With --maneuverd the server reads the configuration that the
pods get, and with --replica a pod's start is played on this machine: what its init container does, then its server.
The schemas of the Kubernetes API are for schemas.cjs.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import unittest

import yaml

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
OVERLAYS = REPOSITORY / "deploy" / "kubernetes" / "overlays"
MADE_BY_HAND = {"Secret": {"maneuverd-tls", "maneuverd-tokens"}, "PersistentVolumeClaim": {"maneuver-published-models"}}
USER = 8470
GRPC_PORT = 8470
METRICS_PORT = 9470
PRESTOP_AND_CHECKPOINT_S = 10
options = argparse.Namespace(maneuverd=None, maneuver=None, small_model=None, trainer=None)


def render(overlay):
    done = subprocess.run(["kubectl", "kustomize", OVERLAYS / overlay], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{overlay}: {done.stderr}")
    return list(yaml.safe_load_all(done.stdout))


def bytes_of(size):
    """size: 512MiB, or 2Gi as Kubernetes writes it."""
    return int(re.match(r"\d+", size)[0]) * {"Mi": 2 ** 20, "Gi": 2 ** 30}[re.search(r"[MG]i", size)[0]]


def settings_of(configuration):
    lines = [line.split("#")[0].strip() for line in configuration.splitlines()]
    return dict(re.split(r"\s*=\s*", line, maxsplit=1) for line in lines if line)


class Overlay:
    def __init__(self, name):
        self.name = name
        self.objects = render(name)
        self.deployment = self.one("Deployment")
        self.pod = self.deployment["spec"]["template"]
        self.server = self.pod["spec"]["containers"][0]
        self.configuration = next(o["data"]["maneuverd.conf"] for o in self.of_kind("ConfigMap")
                                  if "maneuverd.conf" in o["data"])

    def of_kind(self, kind):
        return [o for o in self.objects if o["kind"] == kind]

    def one(self, kind):
        found = self.of_kind(kind)
        assert len(found) == 1, f"{self.name} has {len(found)} of {kind}"
        return found[0]

    def containers(self):
        return self.pod["spec"].get("initContainers", []) + self.pod["spec"]["containers"]


class ManifestsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.overlays = [Overlay(path.name) for path in sorted(OVERLAYS.iterdir())
                        if path.name not in ("edge", "shared", "shared-store", "training")]
        assert [o.name for o in cls.overlays] == ["fleet", "fleet-tls", "one-node"]

    def for_each(self):
        for overlay in self.overlays:
            with self.subTest(overlay.name):
                yield overlay

    def test_whatever_is_named_is_there(self):
        for overlay in self.for_each():
            named = [(source["configMap"]["name"], "ConfigMap") for source in overlay.pod["spec"]["volumes"]
                     if "configMap" in source]
            named += [(source["secret"]["secretName"], "Secret") for source in overlay.pod["spec"]["volumes"]
                      if "secret" in source]
            named += [(source["persistentVolumeClaim"]["claimName"], "PersistentVolumeClaim")
                      for source in overlay.pod["spec"]["volumes"] if "persistentVolumeClaim" in source]
            named += [(source["configMapRef"]["name"], "ConfigMap") for source in overlay.server.get("envFrom", [])]
            for name, kind in named:
                made = {o["metadata"]["name"] for o in overlay.of_kind(kind)} | MADE_BY_HAND.get(kind, set())
                self.assertIn(name, made)
            volumes = {volume["name"] for volume in overlay.pod["spec"]["volumes"]}
            mounted = {mount["name"] for container in overlay.containers() for mount in container["volumeMounts"]}
            self.assertEqual(mounted, volumes)

    def test_selectors_find_the_pods_and_ports_are_theirs(self):
        for overlay in self.for_each():
            labels = overlay.pod["metadata"]["labels"].items()
            selectors = [overlay.deployment["spec"]["selector"]["matchLabels"]]
            selectors += [service["spec"]["selector"] for service in overlay.of_kind("Service")]
            selectors += [o["spec"]["selector"]["matchLabels"] for o in overlay.of_kind("PodDisruptionBudget")]
            selectors += [o["spec"]["podSelector"]["matchLabels"] for o in overlay.of_kind("NetworkPolicy")]
            for selector in selectors:
                self.assertTrue(selector)
                self.assertLessEqual(selector.items(), labels)
            ports = {port["name"]: port["containerPort"] for port in overlay.server["ports"]}
            self.assertEqual(ports, {"grpc": GRPC_PORT, "metrics": METRICS_PORT})
            for service in overlay.of_kind("Service"):
                for port in service["spec"]["ports"]:
                    self.assertEqual(ports[port["targetPort"]], port["port"])
            headless = [s["metadata"]["name"] for s in overlay.of_kind("Service") if s["spec"].get("clusterIP") == "None"]
            self.assertEqual(headless, ["maneuverd-replicas"])

    def test_a_pod_has_time_to_drain(self):
        for overlay in self.for_each():
            settings = settings_of(overlay.configuration)
            delay = int(settings["shutdown-delay"])
            readiness = overlay.server["readinessProbe"]
            self.assertLess(readiness["periodSeconds"] * (readiness["failureThreshold"] + 1), delay)
            self.assertGreaterEqual(overlay.pod["spec"]["terminationGracePeriodSeconds"],
                                    delay + 2 * int(settings["shutdown-timeout"]) + PRESTOP_AND_CHECKPOINT_S)
            if overlay.name != "one-node":
                rolling = overlay.deployment["spec"]["strategy"]["rollingUpdate"]
                self.assertEqual((rolling["maxUnavailable"], rolling["maxSurge"]), (0, 1))

    def test_replicas_are_ready_with_a_model_and_who_learns_without(self):
        for overlay in self.for_each():
            path = "/readyz?service=" if overlay.name == "one-node" else "/readyz"
            self.assertEqual(overlay.server["readinessProbe"]["httpGet"], {"path": path, "port": "metrics"})
            for probe in ("livenessProbe", "startupProbe"):
                self.assertEqual(overlay.server[probe]["httpGet"], {"path": "/healthz", "port": "metrics"})

    def test_the_server_keeps_within_the_memory_of_its_container(self):
        for overlay in self.for_each():
            limit = bytes_of(settings_of(overlay.configuration)["memory-limit"])
            container = bytes_of(overlay.server["resources"]["limits"]["memory"])
            self.assertLessEqual(limit, 3 / 4 * container)
            if "trainer" in overlay.server["image"]:
                # Kubernetes kills all processes of a container that takes more.
                variables = {v["name"]: v["value"] for v in overlay.server["env"]}
                self.assertLess(limit + (int(variables["MANEUVERD_JOB_MEMORY_LIMIT"]) << 20), container)

    def test_a_data_folder_is_of_one_server(self):
        for overlay in self.for_each():
            data = next(v for v in overlay.pod["spec"]["volumes"] if v["name"] == "data")
            if "emptyDir" not in data:
                self.assertEqual(overlay.deployment["spec"]["strategy"], {"type": "Recreate"})
                self.assertEqual(overlay.deployment["spec"]["replicas"], 1)
                self.assertEqual(overlay.of_kind("HorizontalPodAutoscaler"), [])

    def test_pods_have_no_rights_to_spare(self):
        for overlay in self.for_each():
            pod = overlay.pod["spec"]
            self.assertIs(pod["enableServiceLinks"], False)
            self.assertIs(pod["automountServiceAccountToken"], False)
            self.assertEqual(pod["securityContext"]["runAsUser"], USER)
            self.assertIs(pod["securityContext"]["runAsNonRoot"], True)
            for container in overlay.containers():
                self.assertEqual(container["securityContext"], {"allowPrivilegeEscalation": False,
                                                                "readOnlyRootFilesystem": True,
                                                                "capabilities": {"drop": ["ALL"]}})
            self.assertTrue(all(m.get("readOnly") for m in overlay.server["volumeMounts"]
                                if m["name"] not in ("data", "temporary")))

    def test_over_tls_files_of_secrets_are_mounted(self):
        overlay = next(o for o in self.overlays if o.name == "fleet-tls")
        for variable in overlay.server["env"]:
            folder = str(pathlib.Path(variable["value"]).parent)
            self.assertIn(folder, [mount["mountPath"] for mount in overlay.server["volumeMounts"]])

    def test_the_server_takes_its_configuration(self):
        if options.maneuverd is None:
            self.skipTest("without --maneuverd")
        for overlay in self.for_each():
            with tempfile.TemporaryDirectory() as folder:
                file = pathlib.Path(folder) / "maneuverd.conf"
                file.write_text(overlay.configuration)
                environment = {v["name"]: v["value"] for v in overlay.server.get("env", [])
                               if v["name"] != "MANEUVERD_TOKENS"}
                for source in overlay.of_kind("ConfigMap"):
                    environment.update({k: v for k, v in source["data"].items() if k.startswith("MANEUVERD_")})
                done = subprocess.run([options.maneuverd, "--config", file, "--print-config"], capture_output=True,
                                      text=True, env=dict(os.environ, **environment))
                self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_replica_serves_what_was_published(self):
        """The fleet's init container and server, with their paths put into a temporary folder."""
        if options.small_model is None:
            self.skipTest("without --small-model")
        fleet = next(o for o in self.overlays if o.name == "fleet")
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            learner = work / "learner" / "models" / "town"
            learner.mkdir(parents=True)
            for version in ("1", "2"):
                subprocess.run([options.small_model, learner / version, version], check=True)
                publish = [REPOSITORY / "deploy" / "publish.sh", work / "learner", f"town/{version}", work / "published"]
                for _ in range(2):  # the second time it is already there
                    subprocess.run(publish, check=True, stdout=subprocess.DEVNULL)
            shutil.rmtree(learner / "2")
            subprocess.run([options.small_model, learner / "2", "3"], check=True)
            changed = subprocess.run(publish, capture_output=True, text=True)
            self.assertEqual(changed.returncode, 1)
            self.assertIn("another model", changed.stderr)

            def moved(text):
                return text.replace("/var/lib/maneuver", f"{work}/data").replace("/published", f"{work}/published")

            # What a killed publication leaves.
            unfinished = work / "published" / "town" / ".unfinished-x"
            unfinished.mkdir()
            (unfinished / "model.json").write_text("{")
            (work / "data").mkdir()
            init = fleet.pod["spec"]["initContainers"][0]
            for _ in range(2):  # a pod that starts again runs it again
                subprocess.run([moved(word) for word in init["command"]], check=True)
            copied = sorted(path.name for path in (work / "data" / "models" / "town").iterdir())
            self.assertEqual(copied, ["1", "2"])
            files = sorted(path.name for path in (work / "data" / "models" / "town" / "2").iterdir())
            self.assertEqual(files, ["model.json", "weights.safetensors"])
            loopback = moved(fleet.configuration).replace("0.0.0.0:8470", "127.0.0.1:0").replace("0.0.0.0:9470", "none")
            (work / "maneuverd.conf").write_text(loopback.replace("shutdown-delay = 10", "shutdown-delay = 0"))
            ports = work / "ports"
            log = open(work / "log", "w")
            server = subprocess.Popen([options.maneuverd, "--config", work / "maneuverd.conf", "--port-file", ports],
                                      env=dict(os.environ, MANEUVERD_SERVE="town/2"), stdout=log, stderr=log)
            try:
                ask = f"""until [ -s {ports} ]; do sleep 0.02; done
                    export MANEUVER_SERVER=$(sed 's/.*"grpc":"\\([^"]*\\).*/\\1/' {ports})
                    until {options.maneuver} health maneuver.v1.PredictionService >/dev/null 2>&1; do sleep 0.1; done
                    {options.maneuver} --output json model list"""
                models = subprocess.run(["sh", "-c", ask], capture_output=True, text=True, timeout=100)
                self.assertEqual(models.returncode, 0, models.stderr + (work / "log").read_text())
                serving = [v["name"] for v in yaml.safe_load(models.stdout)["modelVersions"] if "serving" in v["aliases"]]
                self.assertEqual(serving, ["models/town/versions/2"], models.stdout)
            finally:
                server.terminate()
                server.wait(60)
                log.close()


class SharedTest(unittest.TestCase):
    """The overlay with servers of several roles over one database and one volume."""

    ROLES = ("api", "serve", "work")

    @classmethod
    def setUpClass(cls):
        cls.objects = render("shared")
        cls.names = {(o["kind"], o["metadata"]["name"]) for o in cls.objects}
        cls.deployments = {o["metadata"]["name"].removeprefix("maneuverd-"): o["spec"]
                           for o in cls.objects if o["kind"] == "Deployment"}
        cls.job = render("shared-store")[0]["spec"]["template"]

    def of_kind(self, kind):
        return [o for o in self.objects if o["kind"] == kind]

    def for_each(self):
        for role in self.ROLES:
            with self.subTest(role):
                deployment = self.deployments[role]
                yield role, deployment, deployment["template"]["spec"], deployment["template"]["spec"]["containers"][0]

    def settings(self, pod, server):
        """What the server reads: its file, and above that the variables."""
        maps = {o["metadata"]["name"]: o["data"] for o in self.of_kind("ConfigMap")}
        file = next(v["configMap"]["name"] for v in pod["volumes"] if v["name"] == "configuration")
        variables = dict(maps[server["envFrom"][0]["configMapRef"]["name"]])
        variables.update({v["name"]: v["value"] for v in server["env"]})
        return maps[file]["maneuverd.conf"], variables

    def test_each_role_is_a_deployment_that_shares_store_and_volume(self):
        self.assertEqual(set(self.deployments), set(self.ROLES))
        for role, deployment, pod, server in self.for_each():
            _, variables = self.settings(pod, server)
            self.assertEqual(variables["MANEUVERD_ROLE"], role)
            self.assertEqual(variables["MANEUVERD_SHARED"], "true")
            volumes = {v["name"]: v for v in pod["volumes"]}
            self.assertEqual({m["name"] for m in server["volumeMounts"]}, set(volumes))
            claim = volumes["data"]["persistentVolumeClaim"]["claimName"]
            self.assertIn(("PersistentVolumeClaim", claim), self.names)
            secret = next(m for m in server["volumeMounts"] if m["name"] == "store")
            self.assertTrue(variables["PGSERVICEFILE"].startswith(secret["mountPath"] + "/"))
            self.assertIn("service=", variables["MANEUVERD_STORE"])
            self.assertEqual(server["image"].split("/")[1].split(":")[0],
                             "maneuverd-trainer" if role == "work" else "maneuverd")
            self.assertEqual(deployment["strategy"]["rollingUpdate"], {"maxUnavailable": 0, "maxSurge": 1})
            self.assertEqual(server["readinessProbe"]["httpGet"], {"path": "/readyz", "port": "metrics"})
        claim, = self.of_kind("PersistentVolumeClaim")
        self.assertEqual(claim["spec"]["accessModes"], ["ReadWriteMany"])

    def test_selectors_find_the_pods_of_their_role(self):
        labels = {role: d["template"]["metadata"]["labels"].items() for role, d in self.deployments.items()}
        for role, deployment, _, _ in self.for_each():
            selectors = [deployment["selector"]["matchLabels"]]
            selectors += [o["spec"]["selector"] for o in self.of_kind("Service") if o["metadata"]["name"].endswith(role)]
            selectors += [o["spec"]["selector"]["matchLabels"] for o in self.of_kind("PodDisruptionBudget")
                          if o["metadata"]["name"].endswith(role)]
            self.assertGreaterEqual(len(selectors), 3)
            for selector in selectors:
                self.assertEqual([r for r in self.ROLES if selector.items() <= labels[r]], [role])

    def test_the_policy_lets_all_roles_reach_the_database_and_callers_reach_them(self):
        policy, = self.of_kind("NetworkPolicy")
        chosen = policy["spec"]["podSelector"]["matchLabels"].items()
        for deployment in self.deployments.values():
            self.assertLessEqual(chosen, deployment["template"]["metadata"]["labels"].items())
        self.assertLessEqual(chosen, self.job["metadata"]["labels"].items())
        self.assertIn(5432, [port["port"] for rule in policy["spec"]["egress"] for port in rule["ports"]])
        self.assertEqual(policy["spec"]["ingress"][0]["from"],
                         [{"podSelector": {"matchLabels": {"maneuver.v1/caller": "true"}}}])
        for service in self.of_kind("Service"):  # a Job is no server
            self.assertFalse(service["spec"]["selector"].items() <= self.job["metadata"]["labels"].items())

    def test_a_pod_has_time_to_drain(self):
        for _, _, pod, server in self.for_each():
            configuration, variables = self.settings(pod, server)
            settings = settings_of(configuration)
            delay = int(variables.get("MANEUVERD_SHUTDOWN_DELAY", settings["shutdown-delay"]))
            timeout = int(variables.get("MANEUVERD_SHUTDOWN_TIMEOUT", settings["shutdown-timeout"]))
            self.assertGreaterEqual(pod["terminationGracePeriodSeconds"], delay + 2 * timeout + PRESTOP_AND_CHECKPOINT_S)

    def test_a_job_is_ended_before_the_container_is_full(self):
        pod = self.deployments["work"]["template"]["spec"]
        server = pod["containers"][0]
        configuration, variables = self.settings(pod, server)
        job = int(variables["MANEUVERD_JOB_MEMORY_LIMIT"]) << 20
        self.assertEqual(bytes_of(variables["MANEUVERD_JOB_MEMORY"]), job)
        self.assertLess(job + bytes_of(settings_of(configuration)["memory-limit"]),
                        bytes_of(server["resources"]["limits"]["memory"]))

    def test_pods_have_no_rights_to_spare(self):
        for pod in [*(d["template"]["spec"] for d in self.deployments.values()), self.job["spec"]]:
            self.assertIs(pod["enableServiceLinks"], False)
            self.assertIs(pod["automountServiceAccountToken"], False)
            self.assertEqual(pod["securityContext"]["runAsUser"], USER)
            self.assertEqual(pod["containers"][0]["securityContext"], {"allowPrivilegeEscalation": False,
                                                                       "readOnlyRootFilesystem": True,
                                                                       "capabilities": {"drop": ["ALL"]}})

    def test_the_server_takes_its_configuration(self):
        if options.maneuverd is None:
            self.skipTest("without --maneuverd")
        for role, _, pod, server in self.for_each():
            configuration, variables = self.settings(pod, server)
            self.assertIn(f"role = {role}", printed(configuration, variables).replace('"', ""))


class EdgeTest(unittest.TestCase):
    """HAProxy in front of the servers, with deploy/balancing/haproxy.cfg."""

    @classmethod
    def setUpClass(cls):
        cls.objects = {o["kind"]: o for o in render("edge")}
        cls.template = cls.objects["Deployment"]["spec"]["template"]
        cls.pod = cls.template["spec"]
        cls.haproxy, = cls.pod["containers"]
        cls.variables = {v["name"]: v["value"] for v in cls.haproxy["env"]}

    def test_the_service_reaches_it_and_it_reaches_the_servers(self):
        labels = self.template["metadata"]["labels"]
        for selector in (self.objects["Deployment"]["spec"]["selector"]["matchLabels"],
                         self.objects["Service"]["spec"]["selector"],
                         self.objects["PodDisruptionBudget"]["spec"]["selector"]["matchLabels"],
                         self.objects["NetworkPolicy"]["spec"]["podSelector"]["matchLabels"]):
            self.assertLessEqual(selector.items(), labels.items())
        ports = {port["name"]: port["containerPort"] for port in self.haproxy["ports"]}
        port, = self.objects["Service"]["spec"]["ports"]
        self.assertEqual(ports[port["targetPort"]], port["port"])
        self.assertTrue(self.variables["MANEUVER_EDGE"].endswith(f":{port['port']}"))
        self.assertTrue(self.variables["MANEUVER_METRICS"].endswith(f":{ports['metrics']}"))
        servers = [o for o in render("one-node") if o["kind"] in ("Service", "NetworkPolicy")]
        accepted = next(o for o in servers if o["kind"] == "NetworkPolicy")["spec"]["ingress"][0]
        self.assertLessEqual(accepted["from"][0]["podSelector"]["matchLabels"].items(), labels.items())
        for name in ("MANEUVER_REPLICA_1", "MANEUVER_REPLICA_2"):
            service, port = self.variables[name].split(":")
            self.assertIn((service, int(port)), [(o["metadata"]["name"], o["spec"]["ports"][0]["port"])
                                                 for o in servers if o["kind"] == "Service"])
        # Without it all callers have the address of a node, and share its limits.
        self.assertEqual(self.objects["Service"]["spec"]["externalTrafficPolicy"], "Local")

    def test_its_variables_are_those_of_the_configuration(self):
        configuration = (REPOSITORY / "deploy" / "balancing" / "haproxy.cfg").read_text()
        for name in self.variables:
            self.assertIn(name, configuration)
        longest = int(re.search(r"hard-stop-after (\d+)s", configuration)[1])
        # The port stays open until endpoints and load balancer have noticed.
        before = int(self.haproxy["lifecycle"]["preStop"]["exec"]["command"][1])
        self.assertGreaterEqual(before, 10)
        self.assertGreater(self.pod["terminationGracePeriodSeconds"], before + longest)

    def test_it_has_no_rights_to_spare(self):
        self.assertIs(self.pod["automountServiceAccountToken"], False)
        self.assertIs(self.pod["securityContext"]["runAsNonRoot"], True)
        self.assertEqual(self.haproxy["securityContext"], {"allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True,
                                                           "capabilities": {"drop": ["ALL"]}})


def printed(configuration, variables):
    """The settings of a server with this file and these variables."""
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "maneuverd.conf"
        file.write_text(configuration)
        done = subprocess.run([options.maneuverd, "--config", file, "--print-config"], capture_output=True, text=True,
                              env=dict(os.environ, **variables))
        assert done.returncode == 0, done.stderr
        return done.stdout


class ComposeTest(unittest.TestCase):
    """deploy/compose/shared.yaml with its HAProxy, as far as that goes without Docker."""

    @classmethod
    def setUpClass(cls):
        cls.folder = REPOSITORY / "deploy" / "compose"
        cls.composition = yaml.safe_load((cls.folder / "shared.yaml").read_text())
        cls.services = cls.composition["services"]
        cls.proxy = (cls.folder / "haproxy.cfg").read_text()

    def test_whatever_is_named_is_there(self):
        for name, service in self.services.items():
            for needed in service.get("depends_on", []):
                self.assertIn(needed, self.services, name)
            for volume in service.get("volumes", []):
                source = volume.split(":")[0]
                if source.startswith("."):
                    self.assertTrue((self.folder / source).exists(), source)
                else:
                    self.assertIn(source, self.composition["volumes"])
        backends = dict(re.findall(r"^ +server (\S+) (\S+) check-proto h1$", self.proxy, re.MULTILINE))
        self.assertEqual(set(backends.values()), {f"{name}:{GRPC_PORT}" for name in ("serve-1", "serve-2", "work")})
        predictions = self.proxy[self.proxy.index("backend predictions"):self.proxy.index("backend management")]
        self.assertNotIn("server work", predictions)

    def test_the_servers_take_their_configuration(self):
        if options.maneuverd is None:
            self.skipTest("without --maneuverd")
        for name in ("serve-1", "serve-2", "work"):
            with self.subTest(name):
                settings = printed("", self.services[name]["environment"])
                self.assertIn("shared = true", settings)
                self.assertIn(f"role = {name.split('-')[0]}", settings.replace('"', ""))

    def test_haproxy_takes_its_configuration(self):
        haproxy = shutil.which("haproxy", path="/usr/sbin:" + os.environ["PATH"])
        if haproxy is None:
            self.skipTest("without haproxy")
        done = subprocess.run([haproxy, "-c", "-f", self.folder / "haproxy.cfg"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)


class TrainingTest(unittest.TestCase):
    """The overlay with a Job: one training by several pods."""

    @classmethod
    def setUpClass(cls):
        objects = {o["kind"]: o for o in render("training")}
        cls.service, cls.settings, cls.policy = (objects[kind] for kind in ("Service", "ConfigMap", "NetworkPolicy"))
        cls.job = objects["Job"]["spec"]
        cls.pod = cls.job["template"]["spec"]
        cls.trainer = cls.pod["containers"][0]
        cls.variables = {v["name"]: v["value"] for v in cls.trainer["env"]}

    def test_the_ranks_are_as_many_as_the_pods_and_find_the_first(self):
        self.assertEqual(self.job["completionMode"], "Indexed")
        self.assertEqual({self.job["completions"], self.job["parallelism"], int(self.variables["WORLD_SIZE"])}, {4})
        # An Indexed Job's pods are called {job}-{index}.{subdomain}, if a headless Service has that name.
        self.assertEqual(self.service["spec"]["clusterIP"], "None")
        self.assertIs(self.service["spec"]["publishNotReadyAddresses"], True)
        self.assertEqual(self.pod["subdomain"], self.service["metadata"]["name"])
        self.assertEqual(self.variables["MASTER_ADDR"], f"maneuver-train-0.{self.pod['subdomain']}")
        port = self.trainer["ports"][0]["containerPort"]
        self.assertEqual({port, self.service["spec"]["ports"][0]["port"], int(self.variables["MASTER_PORT"])}, {port})
        labels = self.job["template"]["metadata"]["labels"]
        self.assertEqual(self.service["spec"]["selector"], labels)
        self.assertEqual(self.policy["spec"]["podSelector"]["matchLabels"], labels)

    def test_whatever_is_named_is_there(self):
        volumes = {v["name"]: v for v in self.pod["volumes"]}
        self.assertEqual({m["name"] for m in self.trainer["volumeMounts"]}, set(volumes))
        self.assertEqual(volumes["settings"]["configMap"]["name"], self.settings["metadata"]["name"])

    def test_pods_have_no_rights_to_spare(self):
        self.assertIs(self.pod["automountServiceAccountToken"], False)
        self.assertIs(self.pod["securityContext"]["runAsNonRoot"], True)
        self.assertEqual(self.trainer["securityContext"], {"allowPrivilegeEscalation": False,
                                                           "readOnlyRootFilesystem": True,
                                                           "capabilities": {"drop": ["ALL"]}})

    def test_the_command_learns_with_the_variables_that_a_job_sets(self):
        """The container's command in two processes of this machine, with its paths put into a temporary folder."""
        if options.trainer is None:
            self.skipTest("without --trainer")
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            for name in ("datasets", "models", "checkpoints", "etc"):
                (work / name).mkdir()
            subprocess.run([options.maneuver, "synthesize", work / "datasets" / "town", "--recordings", "12"],
                           check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            settings = json.loads(self.settings["data"]["settings.json"])
            settings.update(threads=1, examples={"max_examples": 128},
                            optimization={"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1,
                                          "posterior_epochs": 1, "covariance_epochs": 1})
            (work / "etc" / "settings.json").write_text(json.dumps(settings))
            command = [options.trainer] + [word.replace("/training", folder).replace("/etc/maneuver", f"{folder}/etc")
                                           for word in self.trainer["command"][1:]]
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                port = free.getsockname()[1]
            variables = os.environ | self.variables | {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1",
                                                       "MASTER_PORT": str(port)}
            pods = [subprocess.Popen(command, env=dict(variables, JOB_COMPLETION_INDEX=str(index)),
                                     stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for index in (0, 1)]
            for pod in pods:
                # A rank that starts before rank 0 listens says so there, and tries again.
                errors = pod.communicate(timeout=200)[1]
                self.assertEqual(pod.returncode, 0, errors)
            self.assertTrue((work / "models" / "town" / "weights.safetensors").exists())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", type=pathlib.Path)
    parser.add_argument("--maneuver", type=pathlib.Path)
    parser.add_argument("--trainer", type=pathlib.Path)
    parser.add_argument("--small-model", type=pathlib.Path, help="program that writes one")
    parser.parse_known_args(namespace=options)
    if shutil.which("kubectl") is None:
        print("SKIPPED: kubectl is not there; apt-get install kubernetes-client")
        sys.exit(0)
    unittest.main(argv=sys.argv[:1])
