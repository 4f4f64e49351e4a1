// Asks a server what the target of a scene will do, from Node 18 or later:
//   npm ci && node predict.mjs SCENE.json [HOST:PORT]
// MANEUVER_PROTO is the folder of the contract: the source's proto, or /usr/share/maneuver/proto of
// the package libmaneuver-client-dev.
import {readFileSync} from 'node:fs';
import {fileURLToPath} from 'node:url';
import grpc from '@grpc/grpc-js';
import {loadSync} from '@grpc/proto-loader';

const proto = process.env.MANEUVER_PROTO ?? fileURLToPath(new URL('../../proto', import.meta.url));
const contract = grpc.loadPackageDefinition(loadSync('maneuver/v1/prediction_service.proto', {
  includeDirs: [proto], keepCase: true, longs: String, enums: String, defaults: true}));

// A scene's JSON may have targetIds as well as target_ids; this loader knows the latter.
const inSnakeCase = (key, value) => value === null || typeof value !== 'object' || Array.isArray(value) ? value :
    Object.fromEntries(Object.entries(value).map(
        ([name, field]) => [name.replace(/[A-Z]/g, (letter) => `_${letter.toLowerCase()}`), field]));

const [, , file, address = '127.0.0.1:8470'] = process.argv;
const client = new contract.maneuver.v1.PredictionService(
    address, grpc.credentials.createInsecure());
const request = {
  scenarios: [JSON.parse(readFileSync(file, 'utf8'), inSnakeCase)],
  query: {top_k: 3}, // the three most probable actions
};

client.Predict(request, {deadline: Date.now() + 5000}, (error, answer) => {
  client.close();
  if (error) {
    console.error(`${grpc.status[error.code]}: ${error.details}`);
    process.exitCode = 1;
    return;
  }
  const last = answer.waypoint_times.length - 1;
  const [scene] = answer.predictions; // a scene or a target of a batch fails alone
  for (const target of scene.error ? [scene] : scene.targets) {
    if (target.error) {
      console.error(target.error.message);
      process.exitCode = 1;
      continue;
    }
    console.log(`vehicle ${target.target_id}, by ${answer.model_version}`);
    for (const action of target.distributions) {
      const {x, y} = action.mean_trajectory; // world frame, metres
      const place = `(${x[last].toFixed(1)}, ${y[last].toFixed(1)})`;
      console.log(`action ${action.action_id}  probability ${action.probability.toFixed(3)}  ` +
          `after ${answer.waypoint_times[last].toFixed(1)} s at ${place}`);
    }
  }
});
