// SPDX-License-Identifier: Apache-2.0
// The live page: takes the stream, draws at the browser's own pace, sends what the operator asks for.

import { Picture } from "./picture.js";
import { Plots } from "./plots.js";

const KEPT = { motion: 6000, truth: 1000, excitation: 3000, command: 3000, ceiling: 3000, efficiency: 3000 };
const DELAY = 0.15; // blocks come every 50 ms: shown so much later, motion is smooth [s]
const PICTURE = 30; // least time between two pictures: 30 a second where the screen has 60 [ms]
const SPAN = 5; // of the motion, at most [s]
const DROPPED = 1013; // another page took this one's place: coming back would end that one
const TRACES = 250, LONG = 1000; // between two drawings of the plots, which cost more than the damper [ms]
const RECONNECT = 1000, SILENT = 1500, SURE = 4000, CLICK = 1000; // [ms]
const LATE = 5000; // a stop pressed without a connection is sent where one comes within this time [ms]
const HELD = "held by the operator";
const find = (id) => document.getElementById(id);
const live = (window.live = { pictures: 0, rows: {}, state: null, run: -1, connections: 0, stream: null }); // also for tests
const picture = new Picture(find("picture")), plots = new Plots(find);
let dropped = "", lastMessage = 0, number = 0, lastEvent = 0, origin = null, radius = null, ahead = null, tone = null, late = 0;
let drive = { name: "support", scale: 1e3, unit: "mm" }; // what is shown of it: its value [m or N] times scale, in unit

const empty = () => {
  for (const name of Object.keys(KEPT)) live.rows[name] = [];
  ahead = tone = null;
  live.spectrum = { frequency: [], support: null, beam: null };
  plots.restart();
};
empty();

// the stream

function connect() {
  live.stream = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream`);
  live.stream.onopen = () => { live.connections++; lastMessage = performance.now(); if (late) ask({ do: "stop" }); };
  live.stream.onmessage = (event) => { lastMessage = performance.now(); receive(JSON.parse(event.data)); };
  live.stream.onclose = (event) => {
    live.stream = null;
    if (event.code === DROPPED) dropped = event.reason;
    else setTimeout(connect, RECONNECT);
  };
}

function receive(message) {
  if (message.type === "hello") return offer(message.methods);
  if (message.type === "answer") return answer(message.success, message.text);
  if (message.type === "all" || message.run !== live.run) empty();
  if (message.type === "all") { find("events").replaceChildren(); lastEvent = 0; }
  live.run = message.run;
  origin = message.origin;
  radius = message.radius;
  if (message.drive.name !== drive.name) driven(message.drive);
  for (const [name, rows] of Object.entries(message.rows)) append(live.rows[name], rows, KEPT[name]);
  const newest = live.rows.motion.at(-1);
  if (newest && message.rows.motion) follow(newest[0] - performance.now() / 1000);
  message.events.forEach(show);
  const before = live.state;
  live.state = message.state;
  if (live.state.excitation.quality === "steady") tone = live.state.excitation.frequency;
  // whether the motor is off, and whether the run is over, is shown at once
  if (before?.motor.mode !== live.state.motor.mode || before?.finished !== live.state.finished) words();
  if (message.spectrum) live.spectrum = message.spectrum; // only where it is new
}

// Names and units of what drives the structure; lengths are shown in mm.
function driven({ name, unit }) {
  drive = { name, scale: unit === "m" ? 1e3 : 1, unit: unit === "m" ? "mm" : unit };
  document.querySelectorAll(".drive").forEach((each) => { each.textContent = name; });
  document.querySelectorAll(".drive-unit").forEach((each) => { each.textContent = drive.unit; });
  find("h-motion").textContent = `${name[0].toUpperCase()}${name.slice(1)} and beam, last seconds`;
  plots.drive = drive.scale;
}

function append(kept, rows, most) {
  for (const row of rows) if (!kept.length || row[0] > kept.at(-1)[0]) kept.push(row);
  if (kept.length > 1.2 * most) kept.splice(0, kept.length - most);
}

// How far the data's time is ahead of the browser's clock: smoothed, so that the motion does not jerk.
function follow(difference) {
  ahead = ahead === null || Math.abs(difference - ahead) > 0.5 ? difference : ahead + 0.05 * (difference - ahead);
}

// the pictures

function between(rows, time, column) {
  let low = 0, high = rows.length - 1;
  if (high < 0) return null;
  if (time >= rows[high][0]) return rows[high][column];
  while (high - low > 1) { const middle = (low + high) >> 1; if (rows[middle][0] <= time) low = middle; else high = middle; }
  const [a, b] = [rows[low], rows[high]];
  if (a[column] === null || b[column] === null || time <= a[0]) return a[column];
  return a[column] + ((b[column] - a[column]) * (time - a[0])) / (b[0] - a[0]);
}

let drawn = 0, drawnMotion = 0, drawnLong = 0, drawnText = 0, drawnSpectrum = null, counted = 0, countedAt = 0, shownTime = null, tracedTime = null;

function draw(now) {
  requestAnimationFrame(draw);
  const { motion, truth, ceiling, command } = live.rows;
  if (ahead !== null && motion.length && now - drawn > PICTURE) {
    const time = Math.min(now / 1000 + ahead - DELAY, motion.at(-1)[0]);
    if (time !== shownTime) {
      shownTime = time;
      drawn = now - Math.min(now - drawn - PICTURE, 8);
      picture.draw({
        support: drive.unit === "mm" ? between(motion, time, 1) : 0, beam: between(motion, time, 2), grain: between(truth, time, 1),
        ceiling: between(truth, time, 2) ?? between(ceiling, time, 1), commanded: between(command, time, 1),
      }, radius);
      live.pictures++;
      counted++;
    }
    if (time !== tracedTime && now - drawnMotion > TRACES) {
      drawnMotion = now;
      plots.drawMotion(motion, (tracedTime = time), SPAN, tone);
    }
  }
  if (now - drawnLong > LONG) { drawnLong = now; plots.drawLong(live.rows); }
  if (live.spectrum && drawnSpectrum !== live.spectrum && now - drawnLong > 100) plots.drawSpectrum((drawnSpectrum = live.spectrum));
  if (now - countedAt > 1000) {
    const rate = Math.round((1000 * counted) / (now - countedAt));
    text("rate", `${rate} picture${rate === 1 ? "" : "s"} a second`);
    counted = 0;
    countedAt = now;
  }
}

// the words

const text = (id, value, bad) => {
  const element = find(id), words = String(value);
  if (element.textContent !== words) element.textContent = words;
  if (bad !== undefined) element.className = bad ? "bad" : "";
};
const known = (value) => value !== null && value !== undefined;
const percent = (value) => (known(value) ? `${Math.round(100 * value)} %`.replace("-", "−") : "–");
const millimetres = (value, digits) => (known(value) ? `${(1e3 * value).toFixed(digits)} mm` : "–");
const decimals = (value, figures) => Math.min(6, Math.max(0, figures - 1 - Math.floor(Math.log10(Math.abs(value) || 1))));
const length = (value) => millimetres(value, known(value) ? decimals(1e3 * value, 3) : 0); // with three figures

// A value as exactly as its standard deviation has it: one figure of that, two where the first is 1 or 2.
function measured(value, deviation, factor, unit) {
  if (!known(value)) return "–";
  const [shown, error] = [factor * value, factor * (deviation ?? 0)];
  if (!(error > 0)) return `${shown.toFixed(decimals(shown, 4))} ${unit}`;
  const places = decimals(error, Number(error.toExponential(0)[0]) < 3 ? 2 : 1);
  return `${shown.toFixed(places)} ± ${error.toFixed(places)} ${unit}`;
}

const share = (found) => (known(found.now) ? `${percent(found.now)}; ${percent(found.mean)}` : "–");

function words() {
  const open = live.stream !== null && live.stream.readyState === 1 && performance.now() - lastMessage < SILENT;
  const state = live.state, ended = Boolean(open && state?.finished), fault = state?.motor.mode === "fault";
  const off = state ? notWell(state) : "", problem = open && state ? lost(state) : "";
  const closed = dropped ? `Closed: ${dropped}; reload this page to have it back` : "No connection to the live page's node: nothing here is up to date; trying again";
  text("link", open ? `Connected${ended ? "; the run is over" : ""}${off}` : closed);
  find("link").className = !open || fault ? "bad" : off || problem || ended ? "" : "good";
  find("lost").hidden = !problem;
  text("lost", problem);
  document.body.dataset.open = open;
  const over = !open || ended || Boolean(state?.lost);
  document.body.classList.toggle("over", over);
  text("h-now", over ? "Last values" : "Now");
  document.querySelectorAll("section button, section select, section input").forEach((each) => { each.disabled = over; });
  find("stop").disabled = ended && (!state.motor.mode || "ceiling/state" in state.silent); // without its node there is none
  if (!state) return;
  const { motor, command, excitation: e, efficiency, reduction, supervisor, recorder } = state;
  text("power", motor.power ?? "not known: no motor node yet", motor.mode === "fault");
  text("mode", [motor.mode ?? "–", motor.homed === false ? "not homed" : "", motor.fault ?? ""].filter(Boolean).join(", "));
  text("reason", command.method ? `${command.method}: ${command.reason}` : "–");
  text("hold", command.reason === HELD ? "End the hold" : "Hold the ceiling");
  text("excitation", known(e.amplitude) ? `${measured(e.amplitude, e.amplitude_std, drive.scale, drive.unit)}, ${e.quality}` : e.quality ?? "–");
  text("frequency", measured(e.frequency, e.frequency_std, 1, "Hz"));
  text("beam", length(e.beam_amplitude));
  text("bare", length(reduction.reference));
  text("closed", length(efficiency.reference));
  text("efficiency", share(efficiency));
  const worse = reduction.now < -0.005; // one per cent
  text("reduction", `${share(reduction)}${worse ? ": worse than without" : ""}`, worse);
  text("commanded", millimetres(command.height, 1));
  text("height", millimetres(motor.height, 1));
  text("recorder", recorder.recording ? `records ${recorder.bag.split("/").slice(-2).join("/")}` : recorder.bag === undefined ? "none yet" : "does not record", recorder.recording === false);
  const end = live.rows.motion.at(-1);
  text("run", state.finished ? `finished: ${state.finished}` : end ? `${end[0].toFixed(1)} s; supervisor: ${supervisor.state ?? "none"}${motor.on ? "" : off}` : "has not begun", fault);
  text("grain", live.rows.truth.length ? "Grain and ceiling as simulated." : "The grain is not measured, so it is not shown.");
  nodes(state.nodes);
}

function notWell({ motor, supervisor }) {
  if (!motor.mode) return "; no motor node yet";
  if (!motor.on) return `; motor off: ${motor.fault || motor.mode}`;
  if (motor.fault) return `; motor: ${motor.fault}`;
  return known(supervisor.state) && supervisor.state !== "ready" ? `; supervisor: ${supervisor.state}` : "";
}

function lost(state) {
  if (state.finished) return "";
  if (!state.seen) return "Nothing has been received from the graph yet.";
  if (state.lost) return "The graph is lost: no topic comes any more.";
  const silent = Object.entries(state.silent).map(([topic, since]) => `${topic} for ${since.toFixed(0)} s`);
  return silent.length ? `Silent: ${silent.join(", ")}` : "";
}

function nodes(found) {
  const list = find("nodes"), excited = found.some((node) => node.name === "excitation_node");
  find("arm-exciter").hidden = !excited;
  find("stop").textContent = excited ? "Stop motor and exciter" : "Stop the motor";
  while (list.children.length > found.length) list.lastChild.remove();
  found.forEach((node, place) => {
    const item = list.children[place] ?? list.appendChild(document.createElement("li"));
    const line = `${node.well ? "✓" : "✗"} ${node.name}: ${node.text}`;
    if (item.textContent !== line) item.textContent = line;
    item.className = node.well ? "" : "bad";
  });
}

function show(event) {
  if (event.number <= lastEvent) return;
  lastEvent = event.number;
  const list = find("events"), item = document.createElement("li");
  const since = origin === null ? "" : `${(event.at - origin).toFixed(1)} s `;
  item.textContent = `${since}${event.severity}, ${event.from}: ${event.text}`;
  item.className = event.severity;
  list.prepend(item);
  while (list.children.length > 200) list.lastChild.remove();
}

// the operator

function ask(request) {
  if (live.stream === null || live.stream.readyState !== 1) {
    if (request.do !== "stop") return answer(false, "there is no connection: nothing was done");
    clearTimeout(late);
    late = setTimeout(giveUp, LATE);
    return answer(false, "there is no connection: nothing was done yet; use the emergency stop");
  }
  if (request.do === "stop") { clearTimeout(late); late = 0; }
  text("answer", "…", false);
  live.stream.send(JSON.stringify({ number: number++, ...request }));
}

function giveUp() {
  late = 0;
  answer(false, `no connection within ${LATE / 1000} s: nothing was done; use the emergency stop`);
}

function answer(success, words) {
  live.answer = { success, words };
  text("answer", success ? `✓ ${words}` : `✗ ${words}`, !success);
}

function offer(methods) {
  const chosen = find("method").value;
  find("method").replaceChildren(...methods.map((name) => new Option(name, name, false, name === chosen)));
}

// A stop begins with the press, not with its end; the click that follows it is not a second one, a key's is the first.
const stop = () => { live.pressed = Date.now(); ask({ do: "stop" }); };
find("stop").onpointerdown = stop;
find("stop").onclick = () => { if (!(Date.now() - live.pressed < CLICK)) stop(); };
find("disarm").onclick = () => ask({ do: "disarm" });
find("hold").onclick = () => ask({ do: "hold", on: live.state?.command.reason !== HELD });
find("choose").onsubmit = (event) => { event.preventDefault(); ask({ do: "method", name: find("method").value }); };
find("mark").onsubmit = (event) => { event.preventDefault(); ask({ do: "note", text: find("note").value }); find("note").value = ""; };

// Arming lets a drive move, that drive alone: it takes a second press.
function arming(id, request, question) {
  const button = find(id), words = button.textContent;
  let sure = 0;
  const offer = (on) => { button.classList.toggle("sure", on); button.textContent = on ? question : words; };
  button.onclick = () => {
    const again = performance.now() < sure;
    sure = again ? 0 : performance.now() + SURE;
    offer(!again);
    if (again) ask({ do: request });
    else setTimeout(() => { if (performance.now() >= sure) offer(false); }, SURE + 50);
  };
}
arming("arm", "arm", "Press once more: the ceiling may move");
arming("arm-exciter", "arm_exciter", "Press once more: a new command may shake the support");

matchMedia("(prefers-color-scheme: dark)").onchange = () => location.reload(); // the pictures take their colours once

connect();
setInterval(words, 250);
requestAnimationFrame(draw);
