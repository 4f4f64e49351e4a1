#!/usr/bin/env node
// Holds what kubectl kustomize makes of each overlay, and the objects that guides show, against the schemas of the Kubernetes API, which
// the package kubernetes-models has as compiled validators:
//   node tests/kubernetes/schemas.cjs [OVERLAY_FOLDER...]
// The API's schemas let fields through that they do not know; here those are errors, too: whatever a
// validator never looks at, is unknown to it. Exit status 77: the modules, or kubectl, are not there.
"use strict";
const { execFileSync } = require("node:child_process");
const fs = require("node:fs");
const path = require("node:path");

let yaml;
try {
  yaml = require("js-yaml");
  require.resolve("kubernetes-models");
  execFileSync("kubectl", ["version", "--client"], { stdio: "ignore" });
} catch (error) {
  console.log(`SKIPPED: see docs/guides/kubernetes.md (${String(error.message).split("\n")[0]})`);
  process.exit(77);
}

const overlays = path.join(__dirname, "..", "..", "deploy", "kubernetes", "overlays");
const guides = path.join(__dirname, "..", "..", "docs", "guides");

// The same object; each path of it that is read gets into `read`.
function watched(value, at, read) {
  if (value === null || typeof value !== "object") return value;
  return new Proxy(value, {
    get(target, key) {
      if (typeof key === "string" && Object.hasOwn(target, key)) {
        read.add(`${at}/${key}`);
        return watched(target[key], `${at}/${key}`, read);
      }
      return Reflect.get(target, key);
    },
  });
}

function* pathsOf(value, at) {
  if (value === null || typeof value !== "object") return;
  for (const [key, child] of Object.entries(value)) {
    yield `${at}/${key}`;
    yield* pathsOf(child, `${at}/${key}`);
  }
}

function modelOf({ apiVersion, kind }) {
  const [group, version] = apiVersion.includes("/") ? apiVersion.split("/") : ["", apiVersion];
  // apps, autoscaling and policy are as they are called; others have their domain.
  return require(["kubernetes-models", group, version, kind].filter(Boolean).join("/"))[kind];
}

// What is wrong with one object.
function faultsOf(object) {
  const read = new Set(["/apiVersion", "/kind"]);
  const faults = [];
  try {
    modelOf(object).prototype.validate.call(watched(object, "", read));
  } catch (error) {
    return [error.message];
  }
  for (const each of pathsOf(object, "")) {
    if (!read.has(each)) faults.push(`${each}: there is no such field`);
  }
  return faults;
}

module.exports = { faultsOf };
if (require.main === module) {
  const folders = process.argv.length > 2
    ? process.argv.slice(2)
    : fs.readdirSync(overlays).map((name) => path.join(overlays, name));
  let failed = 0;
  const check = (name, text) => {
    for (const object of yaml.loadAll(text)) {
      const faults = faultsOf(object);
      failed += faults.length;
      console.log(`${name} ${object.kind} ${object.metadata.name}: ${faults.length ? "" : "valid"}`);
      for (const fault of faults) console.log(`  ${fault}`);
    }
  };
  for (const folder of folders) {
    check(path.basename(folder),
      execFileSync("kubectl", ["kustomize", folder], { encoding: "utf8", stdio: ["ignore", "pipe", "ignore"] }));
  }
  for (const guide of fs.readdirSync(guides)) {
    const page = fs.readFileSync(path.join(guides, guide), "utf8");
    for (const [, text] of page.matchAll(/^```yaml\n(apiVersion:.*?)^```$/gms)) check(guide, text);
  }
  process.exit(failed ? 1 : 0);
}
