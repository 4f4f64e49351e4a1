#!/usr/bin/env node
// Runs one SQL statement in DuckDB and prints its rows as JSON: node duckdb.cjs "SELECT ..."
// Exit status 77: the module of package.json is not there.
"use strict";
let duckdb;
try {
  duckdb = require("@duckdb/node-api");
} catch (error) {
  console.log(`SKIPPED: see tests/fleet/package.json (${String(error.message).split("\n")[0]})`);
  process.exit(77);
}

(async () => {
  const instance = await duckdb.DuckDBInstance.create(":memory:");
  const connection = await instance.connect();
  const reader = await connection.runAndReadAll(process.argv[2]);
  const rows = reader.getRowObjectsJson();
  console.log(JSON.stringify(rows));
})().catch((error) => {
  console.error(String(error));
  process.exit(1);
});
