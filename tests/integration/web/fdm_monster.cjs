// SPDX-License-Identifier: GPL-3.0-or-later
// node fdm_monster.cjs DIST URL USER TOKEN FILE: FDM Monster's own PrusaLink and OctoPrint clients, DIST being the
// folder of that name in its package, send FILE to a fab and pause and end its print.
"use strict";
const path = require("path");
const [dist, url, user, token, file] = process.argv.slice(2);
const load = (name) => require(path.join(dist, name));
const { PrusaLinkApi } = load("services/prusa-link/prusa-link.api.js");
const { OctoprintClient } = load("services/octoprint/octoprint.client.js");
const { HttpClientFactory } = load("services/core/http-client.factory.js");

const nothing = () => {};
const logs = () => ({ debug: nothing, log: nothing, warn: console.error, error: console.error });
const events = { emit: nothing };
const settings = { getTimeoutSettings: () => ({ apiTimeout: 5000, apiUploadTimeout: 20000 }) };
const factory = new HttpClientFactory(settings);
const name = path.basename(file);

(async () => {
  const link = new PrusaLinkApi(logs, events, factory, settings, { printerURL: url, username: user, password: token });
  console.log("version", await link.getVersion());
  const buffer = Object.assign(require("fs").readFileSync(file), { originalname: name });
  await link.uploadFile(buffer, false);
  await link.uploadFile({ path: file, originalname: name }, true);
  await link.pausePrint();
  await link.cancelPrint();
  const octoprint = new OctoprintClient(logs, factory, events, settings);
  const login = { printerURL: url, apiKey: token };
  console.log("text", (await octoprint.getApiVersion(login)).data.text);
  await octoprint.uploadFileAsMultiPart(login, { path: file, originalname: name }, true);
})().catch((error) => {
  console.error(error);
  process.exit(1);
});
