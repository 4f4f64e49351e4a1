"""The wheel: what a pip of elsewhere installs."""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import zipfile

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


class WheelTest(unittest.TestCase):

    def test_has_the_modules_and_what_is_generated(self):
        with tempfile.TemporaryDirectory() as folder:
            # Setuptools leaves files beside the sources.
            source = pathlib.Path(folder, "source")
            shutil.copytree(REPOSITORY / "client/python", source / "client/python")
            shutil.copytree(REPOSITORY / "proto", source / "proto")
            built = subprocess.run(
                [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder,
                 source / "client/python"],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            self.assertEqual(built.returncode, 0, built.stdout)
            wheels = list(pathlib.Path(folder).glob("*.whl"))
            self.assertEqual(len(wheels), 1)
            names = set(zipfile.ZipFile(wheels[0]).namelist())
        for module in REPOSITORY.glob("client/python/maneuver/*.py"):
            self.assertIn(f"maneuver/{module.name}", names)
        for proto in REPOSITORY.glob("proto/maneuver/v1/*.proto"):
            self.assertIn(f"maneuver/v1/{proto.stem}_pb2.py", names)
            self.assertIn(f"maneuver/v1/{proto.stem}_pb2.pyi", names)
        self.assertIn("maneuver/py.typed", names)
        self.assertIn("maneuver/v1/prediction_service_pb2_grpc.py", names)
        version = re.search(r"project\(maneuver VERSION (\S+)",
                            (REPOSITORY / "CMakeLists.txt").read_text())[1]
        self.assertEqual(wheels[0].name, f"maneuver-{version}-py3-none-any.whl")


if __name__ == "__main__":
    unittest.main()
