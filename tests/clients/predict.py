#!/usr/bin/python3
"""Asks a server with Python's grpcio: health, a prediction, and an error with its details.

Needs python3-grpcio, python3-protobuf and protoc, as Debian has them. Prints what came as JSON.
"""

import argparse
import importlib
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import grpc
from google.protobuf import json_format

HERE = pathlib.Path(__file__).resolve().parent
CONTRACT = HERE.parent.parent / "proto"


def load_messages(folder):
    """The Python modules of the contract and of the health service, made in `folder`."""
    contract = sorted(str(p) for p in (CONTRACT / "maneuver" / "v1").glob("*.proto"))
    for root, files in ((CONTRACT, contract), (HERE, [str(HERE / "health.proto")])):
        subprocess.run(["protoc", f"--proto_path={root}", f"--python_out={folder}", *files], check=True)
    sys.path.insert(0, folder)
    return (importlib.import_module("maneuver.v1.prediction_service_pb2"),
            importlib.import_module("maneuver.v1.status_pb2"), importlib.import_module("health_pb2"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address", help="HOST:PORT of a server in plain text")
    parser.add_argument("--request", default=HERE / "request.json", type=pathlib.Path)
    parser.add_argument("--record", type=pathlib.Path,
                        help="write the request, as HTTP/2 carries it, to this file, for h2load; and end")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        prediction, status, health = load_messages(folder)
    request = json_format.Parse(options.request.read_text(), prediction.PredictRequest())
    if options.record:
        message = request.SerializeToString()
        options.record.write_bytes(struct.pack(">BI", 0, len(message)) + message)  # not compressed
        return

    with grpc.insecure_channel(options.address) as channel:
        check = channel.unary_unary("/grpc.health.v1.Health/Check",
                                    request_serializer=health.HealthCheckRequest.SerializeToString,
                                    response_deserializer=health.HealthCheckResponse.FromString)
        predict = channel.unary_unary("/maneuver.v1.PredictionService/Predict",
                                      request_serializer=prediction.PredictRequest.SerializeToString,
                                      response_deserializer=prediction.PredictResponse.FromString)
        answer = {}
        serving = check(health.HealthCheckRequest(service="maneuver.v1.PredictionService"), timeout=20)
        answer["health"] = health.HealthCheckResponse.ServingStatus.Name(serving.status)
        response = predict(request, timeout=20)
        answer["model_version"] = response.model_version
        answer["probabilities"] = list(response.predictions[0].targets[0].probabilities)
        request.model = "models/nowhere"
        try:
            predict(request, timeout=20)
        except grpc.RpcError as error:
            details = dict(error.trailing_metadata())["grpc-status-details-bin"]
            info = status.ErrorInfo()
            info.ParseFromString(status.Status.FromString(details).details[0].value)
            answer["error"] = {"code": error.code().name, "reason": info.reason}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
