// ONNX Runtime beside the engine, in turn in one run, on one thread each: the networks up to p(y|s)
// for eight targets of one scene.
//
//   node onnxruntime.cjs MODEL_FOLDER [DATASET_FOLDER]
//
// BIN (build/release/bin) is where the programs are; ROUNDS (40) how often each takes its turn; F32=1
// has the engine take f32 where it would take bf16. Ends with status 1 if the two give other probabilities.
'use strict';

const { execFileSync, spawn } = require('node:child_process');
const fs = require('node:fs');
const os = require('node:os');
const path = require('node:path');
const readline = require('node:readline');
const ort = require('onnxruntime-node');

const BOUND = 1e-5; // of a probability, between two orders of summation in f32
const TURN = 0.05; // seconds

const bin = process.env.BIN || path.join(__dirname, '../../../build/release/bin');
const rounds = Number(process.env.ROUNDS || 40);

const quantile = (values, share) =>
  [...values].sort((a, b) => a - b)[Math.floor(share * (values.length - 1))];
const median = (values) => quantile(values, 0.5);

// The engine, which takes its turns when it is told to.
class Engine {
  constructor(model, dataset, file) {
    const args = ['--turns', file, '--model', model];
    if (dataset) args.push('--dataset', dataset);
    if (process.env.F32) args.push('--f32');
    this.process = spawn(path.join(bin, 'maneuver-bench'), args, {
      stdio: ['pipe', 'pipe', 'inherit'],
    });
    this.lines = readline.createInterface({ input: this.process.stdout })[Symbol.asyncIterator]();
  }
  async line() {
    const { value, done } = await this.lines.next();
    if (done) throw new Error('maneuver-bench ended early');
    return value;
  }
  // The networks up to p(y|s), with the comparison of actions with lane paths.
  async encode(repeats) {
    this.process.stdin.write(`encode ${repeats}\n`);
    return Number(await this.line());
  }
  // That comparison alone, which ONNX Runtime gets as an input.
  async compare(repeats) {
    this.process.stdin.write(`compare ${repeats}\n`);
    return Number(await this.line());
  }
  end() {
    this.process.stdin.end();
  }
}

async function main() {
  const [model, dataset] = process.argv.slice(2);
  if (!model) throw new Error('usage: onnxruntime.cjs MODEL_FOLDER [DATASET_FOLDER]');
  const work = fs.mkdtempSync(path.join(os.tmpdir(), 'peers-'));
  process.on('exit', () => fs.rmSync(work, { recursive: true, force: true }));
  const network = path.join(work, 'network.onnx');
  execFileSync(
    path.join(bin, 'maneuver'),
    ['model', 'export', model, '--onnx', network, '--probabilities-only'],
    { stdio: ['ignore', 'ignore', 'inherit'] },
  );
  const inputs = path.join(work, 'inputs');
  const engine = new Engine(model, dataset, inputs);
  const sizes = JSON.parse(await engine.line());

  const bytes = fs.readFileSync(inputs);
  const floats = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4);
  const { scenes, actions } = sizes;
  let at = 0;
  const take = (count) => floats.slice(at, (at += count));
  const feeds = {};
  for (const { name, sizes: shape } of sizes.inputs) {
    feeds[name] = new ort.Tensor('float32', take(shape.reduce((a, b) => a * b)), shape);
  }
  const expected = take(scenes * actions);

  const session = await ort.InferenceSession.create(network, {
    intraOpNumThreads: 1,
    interOpNumThreads: 1,
    executionMode: 'sequential',
    graphOptimizationLevel: 'all',
    executionProviders: ['cpu'],
  });
  const run = () => session.run(feeds, ['probabilities']);
  const { probabilities } = await run();
  let difference = 0;
  expected.forEach((p, i) => {
    difference = Math.max(difference, Math.abs(p - probabilities.data[i]));
  });

  const theirs = async (repeats) => {
    const begin = process.cpuUsage();
    for (let i = 0; i < repeats; i++) await run();
    const { user, system } = process.cpuUsage(begin);
    return (user + system) / 1e6;
  };
  // Turns of about the same length; the first two are not counted.
  const repeats = Math.max(1, Math.round((3 * TURN) / ((await theirs(3)) + 1e-9)));
  await engine.encode(repeats);
  await theirs(repeats);
  const ours = [];
  const comparisons = [];
  const ratios = [];
  const networkRatios = [];
  const others = [];
  for (let i = 0; i < rounds; i++) {
    ours.push((await engine.encode(repeats)) / repeats / scenes);
    comparisons.push((await engine.compare(repeats)) / repeats / scenes);
    others.push((await theirs(repeats)) / repeats / scenes);
    ratios.push(others[i] / ours[i]);
    networkRatios.push(others[i] / (ours[i] - comparisons[i]));
  }
  engine.end();

  const us = (seconds) => (1e6 * seconds).toFixed(1);
  const spread = (values) =>
    `${median(values).toFixed(2)} (middle half ${quantile(values, 0.25).toFixed(2)} to ` +
    `${quantile(values, 0.75).toFixed(2)})`;
  console.log(
    `${sizes.model}, ${sizes.inputs.map((input) => `${input.name} ${input.sizes.slice(1).join('x')}`).join(', ')}, ` +
      `batch ${scenes}, one thread, ${rounds} rounds\n` +
      `engine (${sizes.precision}): ${us(median(ours))} us a target, of which comparing actions ` +
      `with lane paths ${us(median(comparisons))}\n` +
      `ONNX Runtime ${require('onnxruntime-node/package.json').version} (f32): ` +
      `${us(median(others))} us a target\n` +
      `ONNX Runtime / engine: ${spread(ratios)}\n` +
      `the same without that comparison, whose result ONNX Runtime gets: ${spread(networkRatios)}\n` +
      `largest difference of p(y|s): ${difference.toExponential(1)}`,
  );
  if (sizes.precision === 'f32' && !(difference <= BOUND)) {
    throw new Error(`the probabilities differ by more than ${BOUND}`);
  }
}

main().catch((error) => {
  console.error(error.message);
  process.exit(1);
});
