// Asks a server with Node's @grpc/grpc-js: health, a prediction, and an error with its details.
// Prints what came as JSON.
//
//   node predict.cjs HOST:PORT          a server in plain text
'use strict';

const fs = require('fs');
const path = require('path');
const grpc = require('@grpc/grpc-js');
const loader = require('@grpc/proto-loader');
const protobuf = require('protobufjs');

const contract = path.join(__dirname, '..', '..', 'proto');
const options = {keepCase: true, longs: String, enums: String, defaults: true};

function load(file, folder) {
  return grpc.loadPackageDefinition(loader.loadSync(file, {...options, includeDirs: [folder]}));
}

// A unary call as a promise.
function call(client, method, request) {
  const deadline = new Date(Date.now() + 20000);
  return new Promise((resolve, reject) => {
    client[method](request, {deadline}, (error, response) => (error ? reject(error) : resolve(response)));
  });
}

function reasonOf(error) {
  const root = new protobuf.Root();
  root.resolvePath = (origin, target) => {
    return target.startsWith('google/') ? null : path.join(contract, target);
  };
  root.loadSync('maneuver/v1/status.proto', {keepCase: true});
  const bytes = error.metadata.get('grpc-status-details-bin')[0];
  const detail = root.lookupType('maneuver.v1.Status').decode(bytes).details[0];
  return root.lookupType('maneuver.v1.ErrorInfo').decode(detail.value).reason;
}

async function main() {
  const credentials = grpc.credentials.createInsecure();
  const health = load('health.proto', __dirname).grpc.health.v1;
  const maneuver = load('maneuver/v1/prediction_service.proto', contract).maneuver.v1;
  const checker = new health.Health(process.argv[2], credentials);
  const predictor = new maneuver.PredictionService(process.argv[2], credentials);
  const request = JSON.parse(fs.readFileSync(path.join(__dirname, 'request.json'), 'utf8'));
  const answer = {};
  answer.health = (await call(checker, 'Check', {service: 'maneuver.v1.PredictionService'})).status;
  const response = await call(predictor, 'Predict', request);
  answer.model_version = response.model_version;
  answer.probabilities = response.predictions[0].targets[0].probabilities;
  try {
    await call(predictor, 'Predict', {...request, model: 'models/nowhere'});
  } catch (error) {
    answer.error = {code: grpc.status[error.code], reason: reasonOf(error)};
  }
  checker.close();
  predictor.close();
  console.log(JSON.stringify(answer));
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
