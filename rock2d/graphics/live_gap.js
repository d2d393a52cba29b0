// The live view of a diagnosis: shows what rock2d/diagnosis/report/live_gap.py has computed, and computes nothing itself.
(async () => {
  const find = (id) => document.getElementById(`live-${id}`), section = document.getElementById("live");
  const { unpacked, starts, columns, fixed, whole, cleared, row, swatch } = live;
  if (!live.able()) return;
  const data = JSON.parse(find("data").textContent), { blocks, causes, models, frames, items } = data;
  const IMPACT = 0, NEAR_PX = 14, CLOSE_RADII = 3.5, LEAST_ASPECT = 0.5, MOST_LISTED = 300, NEIGHBOURS = 5, BASE = "#d55e00", CHOSEN = "#0072b2", FILM = "#333333";
  const CHANGED = 7; // numbers of an item for each model: σ, two places in mm, angle in °, three velocities

  // ---- data -------------------------------------------------------------------------------------------------------
  const itemRaw = await unpacked(items.rows), count = items.count;
  const column = (i) => new Float32Array(itemRaw, 4 * i * count, count);
  const [ofRelease, ofBlock, ofZone, ofPhase, ofTime, ofUntil, ofX, ofY] = Array(items.measured).fill().map((_, i) => column(i));
  const velocities = [0, 1].map((k) => [0, 1, 2].map((c) => column(items.measured + 3 * k + c))); // before, after
  const left = models.map((_, m) => Array(CHANGED).fill().map((_, c) => column(items.measured + 6 + CHANGED * m + c)));
  const first = starts(frames.counts), total = first.at(-1);
  const [t, ...pose] = columns(await unpacked(frames.rows), frames.scales, data.steps, total);
  const segment = new Int32Array(total).fill(-1);
  frames.segments.forEach(([a, b], s) => segment.fill(s, a, b));
  const every = [...Array(count).keys()].sort((a, b) => left[0][0][b] - left[0][0][a]); // the largest residuals first

  // ---- state, also in the address ---------------------------------------------------------------------------------
  const state = {}, LEARNT = causes.indexOf("learnt");
  function readAddress() {
    const said = live.address(), chosen = said.get("causes");
    state.causes = new Set(causes.keys());
    if (chosen !== null) state.causes = new Set(chosen.split(",").map((name) => causes.indexOf(name)).filter((i) => i >= 0));
    state.block = whole(said.get("block"), blocks.length);
    state.zone = whole(said.get("zone"), data.zones.length);
    state.phase = whole(said.get("phase"), data.phases.length);
    state.size = whole(said.get("size"), data.sizes.length) || 0;
    state.item = said.has("item") ? whole(said.get("item"), count) : "";
    state.close = said.get("close") !== "0";
    const release = said.has("release") ? data.released.indexOf(Number(said.get("release"))) : -1;
    state.release = frames.release.indexOf(release);
    if (state.release < 0) state.release = frames.release.indexOf(state.item === "" ? ofRelease[every[0]] : ofRelease[state.item]);
    const at = Number(said.get("t"));
    state.time = said.has("t") && Number.isFinite(at) ? at : ofUntil[state.item === "" ? worstOf(state.release) : state.item] ?? 0;
  }
  const worstOf = (release) => every.find((i) => ofRelease[i] === frames.release[release] && ofPhase[i] === IMPACT);
  const writeAddress = () => live.writeAddress(() => ({
    release: data.released[frames.release[state.release]],
    ...(causes.length && { causes: live.sorted(state.causes).map((i) => causes[i]).join() }),
    ...Object.fromEntries(["block", "zone", "phase", "item"].filter((k) => state[k] !== "").map((k) => [k, state[k]])),
    ...(state.size && { size: state.size }),
    ...(!state.close && { close: 0 }),
    t: +fixed(player.time, 5),
  }));
  const model = () => models.findIndex((own) => own.length === state.causes.size && own.every((i) => state.causes.has(i)));
  const shown = () => Math.max(model(), 0); // the base law where the causes were not computed together
  const passes = (i) =>
    (state.block === "" || ofBlock[i] === state.block) && (state.zone === "" || ofZone[i] === state.zone) &&
    (state.phase === "" || ofPhase[i] === state.phase) && left[shown()][0][i] >= data.sizes[state.size];

  // ---- which and how far ------------------------------------------------------------------------------------------
  const boxes = [...section.querySelectorAll("input[name=cause]")];
  function fillModel() {
    const m = model();
    boxes.forEach((box, i) => {
      box.checked = state.causes.has(i);
      box.closest("tr").classList.toggle("off", !box.checked);
    });
    for (const part of section.querySelectorAll(".live-model")) part.hidden = Number(part.dataset.model) !== m;
    const unknown = "These causes were not computed together. Tick none, one, all but one, or all. The base law is shown.";
    find("model").textContent = m < 0 ? unknown : `Model: ${data.labels[m]}`;
  }
  function fillChannels() {
    const parts = data.channels[state.block === "" ? 0 : 1 + state.block][state.zone === "" ? 0 : 1 + state.zone];
    const m = shown(), body = emptied(find("channels"), ["", "n", data.labels[0], ...(m ? [data.labels[m]] : [])]);
    parts.forEach(([n, channels], phase) => {
      if (state.phase !== "" && state.phase !== phase) return;
      channels.forEach((own, c) => {
        row(body, [`${data.phases[phase]}, ${data.channel_names[phase][c]}`, n, own[0], ...(m ? [own[m]] : [])]);
      });
    });
    fillZones();
  }
  function emptied(table, head) {
    table.tHead.replaceChildren();
    table.tBodies[0].replaceChildren();
    row(table.tHead, head, "th");
    return table.tBodies[0];
  }
  function pressed(cell, text, on, press) { // a button in a cell of a table
    const button = cell.appendChild(document.createElement("button")), table = cell.closest("table");
    [button.type, button.textContent] = ["button", text];
    button.setAttribute("aria-pressed", on);
    button.addEventListener("click", () => { press(); [...table.querySelectorAll("button")].find((own) => own.textContent === text)?.focus(); });
  }
  const compared = () => [...new Set([0, shown()])]; // the base law, and the model of the ticked causes
  const short = (m) => (m ? "ticked causes" : data.labels[0]);
  function fillZones() { // typical residuals zone by zone
    const m = shown(), own = data.channels[state.block === "" ? 0 : 1 + state.block];
    const models = compared(), head = data.phases.flatMap((phase) => [`${phase}s`, ...models.map(short)]);
    const body = emptied(find("zones"), ["", ...head]);
    data.zones.forEach((zone, z) => {
      const parts = own[1 + z];
      if (!parts.some(([n]) => n)) return;
      const made = row(body, ["", ...parts.flatMap(([n, [together]]) => [n, ...models.map((k) => together[k])])]);
      pressed(made.cells[0], zone, state.zone === z, () => { state.zone = state.zone === z ? "" : z; find("zone").value = state.zone; modelChanged(); });
    });
  }

  // ---- where ------------------------------------------------------------------------------------------------------
  const stage = find("stage"), [ground, marks, top] = stage.children, view = new live.View(stage, data.limits);
  const nearStage = find("near"), [nearGround, nearTop] = nearStage.children, near = new live.View(nearStage, data.limits);
  const colourOf = (sigma) => data.classes.findLast(([least]) => sigma >= least)[1];
  const gap = (i, m, c) => left[m][c][i];
  const sigma = (i, m) => `${fixed(left[m][0][i], 1)} σ`;
  const placed = (i) => `release ${data.released[ofRelease[i]]}, ${blocks[ofBlock[i]].name}, ${data.phases[ofPhase[i]]}, ${data.zones[ofZone[i]]}, t = ${fixed(ofTime[i], 3)} s`;
  const named = (i) => `${sigma(i, 0)}${shown() ? ` → ${sigma(i, shown())}` : ""}: ${placed(i)}`;
  function drawMarks() {
    const pen = cleared(marks), own = every.filter(passes);
    pen.save();
    view.clip(pen);
    pen.strokeStyle = "#5a6a78";
    pen.globalAlpha = Math.min(Math.max(60 / data.flights.length, 0.1), 0.5);
    for (const path of data.flights) view.line(pen, path), pen.stroke();
    pen.globalAlpha = 1;
    for (const i of own.toReversed()) { // the largest on top
      const size = left[shown()][0][i], radius = 2.5 + Math.min(size, 5);
      pen.fillStyle = colourOf(size);
      pen.strokeStyle = "#444";
      pen.lineWidth = 0.6;
      pen.beginPath();
      if (ofPhase[i] === IMPACT) pen.arc(view.x(ofX[i]), view.y(ofY[i]), radius, 0, 2 * Math.PI);
      else pen.rect(view.x(ofX[i]) - 0.8 * radius, view.y(ofY[i]) - 0.8 * radius, 1.6 * radius, 1.6 * radius);
      pen.fill();
      pen.stroke();
    }
    pen.restore();
    const list = own.slice(0, MOST_LISTED), choice = find("item");
    if (state.item !== "" && !list.includes(state.item)) list.push(state.item);
    const none = new Option(`choose one of ${own.length}${own.length > MOST_LISTED ? `, the largest ${MOST_LISTED}` : ""}`, "");
    choice.replaceChildren(none, ...list.map((i) => new Option(named(i), i)));
    choice.value = state.item;
    find("said").textContent = `${own.length} of ${count} impacts and flights shown`;
  }
  function fillItem() {
    const table = find("one"), i = state.item;
    table.hidden = find("neighbours").hidden = i === "";
    if (i === "") return;
    fillNeighbours(i);
    table.caption.textContent = placed(i);
    const own = compared(), digits = (v, n) => (Number.isFinite(v) ? fixed(v, n) : "-");
    if (ofPhase[i] === IMPACT) {
      emptied(table, ["", "along the ground (m/s)", "across (m/s)", "spin (rad/s)", "off along (mm)", "off across (mm)", "off in angle (°)", "residual"]);
      const speeds = (three) => three.map((v, c) => digits(v, c < 2 ? 3 : 2));
      ["before, measured", "after, measured"].forEach((name, k) =>
        row(table.tBodies[0], [name, ...speeds(velocities[k].map((v) => v[i])), "", "", "", ""]));
      for (const m of own) {
        const [, ...rest] = left[m].map((v) => v[i]);
        row(table.tBodies[0], [`after, ${data.labels[m]}`, ...speeds(rest.slice(3)), ...rest.slice(0, 3).map((v) => digits(v, 2)), sigma(i, m)]);
      }
    } else {
      emptied(table, ["bend of the flight that is left", "x (mm)", "y (mm)", "angle (°)", "residual"]);
      for (const m of own) row(table.tBodies[0], [data.labels[m], ...[1, 2, 3].map((c) => digits(left[m][c][i], 3)), sigma(i, m)]);
    }
  }
  function fillNeighbours(i) { // is the gap of this place, or of this release?
    const away = (k) => 1e3 * Math.hypot(ofX[k] - ofX[i], ofY[k] - ofY[i]), models = compared();
    const alike = every.filter((k) => k !== i && ofPhase[k] === ofPhase[i] && ofBlock[k] === ofBlock[i]);
    const body = emptied(find("neighbours"), ["", "away (mm)", ...models.map(short)]);
    for (const k of alike.sort((a, b) => away(a) - away(b)).slice(0, NEIGHBOURS)) {
      const made = row(body, ["", fixed(away(k), 1), ...models.map((m) => sigma(k, m))]);
      pressed(made.cells[0], placed(k), false, () => choose(k));
    }
  }
  function itemNear([mx, my]) {
    let best = NEAR_PX, found = "";
    for (const i of every) {
      const miss = passes(i) ? Math.hypot(view.x(ofX[i]) - mx, view.y(ofY[i]) - my) : best;
      if (miss < best) [best, found] = [miss, i];
    }
    return found;
  }

  // ---- one release ------------------------------------------------------------------------------------------------
  const begin = () => first[state.release], end = () => first[state.release + 1];
  const ofThis = (s) => frames.segments[s][0] >= begin() && frames.segments[s][0] < end();
  function frameAt(time) {
    const slack = (0.05 * (t[end() - 1] - t[begin()])) / (end() - begin()); // packed times are rounded
    let i = begin();
    while (i < end() - 1 && t[i + 1] <= time + slack) i++;
    return i;
  }
  const poseOf = (i, m) => [0, 1, 2].map((c) => pose[c][i] + (m < 0 ? 0 : pose[3 + 3 * m + c][i]));
  function outline(pen, [x, y, theta], block, known) {
    const [c, s] = [Math.cos(theta), Math.sin(theta)];
    near.line(pen, block.outline.map(([a, b]) => [x + c * a - s * b, y + s * a + c * b]));
    pen.closePath();
    if (known) pen.moveTo(near.x(x), near.y(y)), pen.lineTo(near.x(x + c * block.inner), near.y(y + s * block.inner));
  }
  const off = (i, m) => {
    const [dx, dy, turn] = [0, 1, 2].map((c) => pose[3 + 3 * m + c][i]);
    return `${fixed(1e3 * Math.hypot(dx, dy), 1)} mm and ${fixed(Math.abs((turn * 180) / Math.PI), 1)}°`;
  };
  const way = () => Array.from({ length: end() - begin() }, (_, k) => [pose[0][begin() + k], pose[1][begin() + k]]);
  function drawTop() { // the chosen release and the chosen impact or flight, on the section
    const pen = cleared(top);
    pen.strokeStyle = CHOSEN;
    pen.lineWidth = 2;
    view.line(pen, way());
    pen.stroke();
    if (state.item === "") return;
    pen.beginPath();
    pen.arc(view.x(ofX[state.item]), view.y(ofY[state.item]), 12, 0, 2 * Math.PI);
    pen.stroke();
  }
  function drawNear() {
    const i = frameAt(player.time), release = frames.release[state.release], known = data.angles[release];
    const block = blocks[data.release_block[release]], m = shown(), inside = segment[i] >= 0, [l, r, b, h] = data.limits;
    const half = CLOSE_RADII * block.radius, high = half * Math.max((h - b) / (r - l), LEAST_ASPECT), [x, y] = poseOf(i, -1);
    near.fit(state.close ? [x - half, x + half, y - high, y + high] : data.limits);
    near.scene(cleared(nearGround), data);
    const pen = cleared(nearTop);
    pen.save();
    near.clip(pen);
    pen.strokeStyle = FILM;
    near.line(pen, way());
    pen.stroke();
    pen.fillStyle = "rgba(60, 60, 60, 0.3)";
    outline(pen, poseOf(i, -1), block, known);
    pen.fill();
    pen.stroke();
    pen.lineWidth = 2;
    for (const [k, colour, dash] of inside ? [[0, BASE, [6, 3]], [m, CHOSEN, []]].slice(0, m ? 2 : 1) : []) {
      pen.strokeStyle = colour;
      pen.setLineDash(dash);
      outline(pen, poseOf(i, k), block, known);
      pen.stroke();
    }
    pen.restore();
    const own = [...frames.segments.keys()].filter(ofThis);
    const where = inside ? `segment ${own.indexOf(segment[i]) + 1} of ${own.length}: base law off by ${off(i, 0)}` : "outside the segments: measured only";
    find("frame").textContent = `t = ${fixed(t[i], 3)} s, frame ${i - begin() + 1} of ${end() - begin()}, ${where}${inside && m ? `; ${data.labels[m]} ${off(i, m)}` : ""}.`;
  }
  function segmentStart(way) { // of the next segment of the release, or of the one before
    const now = player.time, at = frames.segments.map(([a]) => t[a]).filter((_, s) => ofThis(s));
    player.pause();
    player.set((way > 0 ? at.find((time) => time > now + 1e-9) : at.findLast((time) => time < now - 1e-9)) ?? now);
  }
  const parts = { clock: find("time"), play: find("play"), back: find("back"), on: find("on"), speed: find("speed") };
  const next = (time, way) => t[Math.min(Math.max(frameAt(time) + way, begin()), end() - 1)];
  const player = new live.Player(parts, next, () => { drawNear(); writeAddress(); });
  function fillRelease() {
    find("release").value = data.released[frames.release[state.release]];
    player.range(t[begin()], t[end() - 1]);
  }
  function fillOwn() { // impacts and flights of the release, in the order of time
    const table = find("own"), release = frames.release[state.release], m = shown();
    const own = every.filter((i) => ofRelease[i] === release).sort((a, b) => ofTime[a] - ofTime[b]);
    const missed = (i, k) => `${sigma(i, k)} (${fixed(Math.hypot(gap(i, k, 1), gap(i, k, 2)), 2)} mm, ${fixed(Math.abs(gap(i, k, 3)), 2)}°)`;
    table.caption.textContent = `Release ${data.released[release]}: residual, miss of place and angle`;
    const models = compared(), body = emptied(table, ["t (s)", "phase", "zone", ...models.map(short)]);
    for (const i of own) {
      const made = row(body, ["", data.phases[ofPhase[i]], data.zones[ofZone[i]], ...models.map((k) => missed(i, k))]);
      pressed(made.cells[0], fixed(ofTime[i], 3), i === state.item, () => choose(i));
    }
  }

  // ---- checks -----------------------------------------------------------------------------------------------------
  const most = Math.max(...data.checks.map((check) => Math.max(check.value, check.percentiles[99])));
  const strips = data.checks.map((check) => {
    const button = document.createElement("button"), name = document.createElement("span"), strip = document.createElement("canvas");
    [button.type, name.textContent, name.className] = ["button", check.name, check.fails ? "fails" : ""];
    strip.className = "plate";
    button.append(name, strip);
    const say = () => {
      for (const other of find("checks").children) other.setAttribute("aria-pressed", other === button);
      find("check-said").textContent = check.said;
    };
    for (const event of ["pointerenter", "focus", "click"]) button.addEventListener(event, say);
    find("checks").append(button);
    return strip;
  });
  function drawChecks() {
    strips.forEach((strip, k) => {
      const pen = cleared(strip), at = (v) => 4 + ((strip.clientWidth - 8) * v) / most, check = data.checks[k];
      pen.fillStyle = FILM;
      pen.globalAlpha = 0.16;
      for (const v of check.percentiles.slice(1, 100)) pen.fillRect(at(v) - 1.5, 4, 3, 10);
      pen.globalAlpha = 1;
      pen.fillStyle = check.fails ? BASE : CHOSEN;
      pen.fillRect(at(check.value) - 2, 0, 4, 18);
    });
  }

  // ---- controls ---------------------------------------------------------------------------------------------------
  function drawSection() {
    view.fit();
    view.scene(cleared(ground), data);
    drawMarks();
    drawTop();
    drawNear();
  }
  function choose(item) {
    state.item = item;
    const release = item === "" ? -1 : frames.release.indexOf(ofRelease[item]);
    if (release >= 0) {
      state.release = release;
      fillRelease();
      player.set(ofUntil[item]);
    }
    fillItem();
    fillOwn();
    drawSection();
    writeAddress();
  }
  function modelChanged() {
    fillModel();
    fillChannels();
    fillItem();
    fillOwn();
    drawSection();
    writeAddress();
  }
  boxes.forEach((box, i) => box.addEventListener("change", () => {
    state.causes[box.checked ? "add" : "delete"](i);
    if (box.checked && i === LEARNT) causes.forEach((_, k) => state.causes.add(k)); // it was fitted beside all causes
    if (!box.checked) state.causes.delete(LEARNT);
    modelChanged();
  }));
  const folded = [...section.querySelectorAll(".live-model details")]; // those of all models open and close together
  for (const own of folded) own.addEventListener("toggle", () => folded.forEach((other) => { other.open = own.open; }));
  for (const name of ["block", "zone", "phase", "size"])
    find(name).addEventListener("change", (event) => {
      state[name] = event.target.value === "" ? "" : Number(event.target.value);
      modelChanged();
    });
  find("item").addEventListener("change", (event) => choose(event.target.value === "" ? "" : Number(event.target.value)));
  find("earlier").addEventListener("click", () => segmentStart(-1));
  find("later").addEventListener("click", () => segmentStart(1));
  stage.addEventListener("click", (event) => choose(itemNear(view.at(event))));
  find("close").addEventListener("change", (event) => { state.close = event.target.checked; drawNear(); writeAddress(); });
  find("release").addEventListener("change", (event) => {
    const release = frames.release.indexOf(data.released.indexOf(Number(event.target.value)));
    if (release < 0) {
      find("frame").textContent = `The page holds no frames of release ${event.target.value}.`;
      return;
    }
    [state.release, state.item] = [release, ""];
    fillRelease();
    fillItem();
    fillOwn();
    player.set(0);
    drawSection();
  });
  function showState() {
    for (const name of ["block", "zone", "phase", "size"]) find(name).value = state[name];
    find("close").checked = state.close;
    fillModel();
    fillChannels();
    fillRelease();
    fillItem();
    fillOwn();
    player.set(state.time);
    drawSection();
    drawChecks();
  }
  window.addEventListener("hashchange", () => { readAddress(); showState(); });
  section.hidden = false;
  const key = [[FILM, "film"], [BASE, data.labels[0]], ...(models.length > 1 ? [[CHOSEN, "ticked causes"]] : [])];
  find("key").append(...key.flatMap(([colour, words]) => [swatch(colour), `${words} `]));
  readAddress();
  showState();
  live.whenResized(stage, () => { drawSection(); drawChecks(); });
})();
