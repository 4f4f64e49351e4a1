"""What one would write in place of maneuverd: grpcio, NumPy and PyTorch; OpenCV for rasters.

  /usr/bin/python3 server.py MODEL_FOLDER [--listen 127.0.0.1:8470]
      [--remember nothing|paths|inputs]

Answers maneuver.v1.PredictionService/Predict with the same weights on the same scenes; for a model
that reads no raster, also RegisterMap. Parses, computes the networks' inputs, evaluates all targets
of a request as one batch in PyTorch's inference mode with a thread for each core, describes the
actions asked for and answers in the world's frame. Nothing is validated, batched over calls,
cancelled or dropped when late.

Prints the address that it listens on, when it is ready.
"""

import argparse
import json
import os
from concurrent import futures

import grpc
import torch

from contract import prediction

SERVICE = "/maneuver.v1.PredictionService/"


def service_of(options):
    with open(os.path.join(options.model, "model.json"), encoding="utf-8") as file:
        reads_raster = "raster" in json.load(file)["spec"]
    if reads_raster:
        from raster_service import RasterService

        return RasterService(options.model)
    from vector_service import VectorService

    return VectorService(options.model, options.remember)


class Handler(grpc.GenericRpcHandler):
    def __init__(self, service):
        self.handlers = {
            SERVICE + "Predict": self._handler(
                service.predict, prediction.PredictRequest, prediction.PredictResponse
            )
        }
        if hasattr(service, "register_map"):
            self.handlers[SERVICE + "RegisterMap"] = self._handler(
                service.register_map, prediction.RegisterMapRequest, prediction.RegisterMapResponse
            )

    @staticmethod
    def _handler(answer, request, response):
        return grpc.unary_unary_rpc_method_handler(
            answer,
            request_deserializer=request.FromString,
            response_serializer=response.SerializeToString,
        )

    def service(self, details):
        return self.handlers.get(details.method)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("--listen", default="127.0.0.1:0")
    parser.add_argument("--threads", type=int, default=2, help="that answer calls")
    parser.add_argument(
        "--remember",
        default="nothing",
        choices=("nothing", "paths", "inputs"),
        help="what vector_service.py keeps from call to call",
    )
    options = parser.parse_args()
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    server = grpc.server(
        futures.ThreadPoolExecutor(options.threads),
        options=[("grpc.max_receive_message_length", 64 << 20)],
    )
    server.add_generic_rpc_handlers((Handler(service_of(options)),))
    port = server.add_insecure_port(options.listen)
    server.start()
    print(f"{options.listen.rsplit(':', 1)[0]}:{port}", flush=True)
    server.wait_for_termination()


if __name__ == "__main__":
    main()
