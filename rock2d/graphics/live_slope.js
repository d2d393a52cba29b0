// The live view of a run: shows the numbers that rock2d/design/live_slope.py has computed, and computes none itself.
(async () => {
  const find = (id) => document.getElementById(`live-${id}`), section = document.getElementById("live");
  const { unpacked, starts, columns, fixed, every, sorted, whole, numbers, cleared, ticks, row, swatch } = live;
  if (!live.able()) return;
  const data = JSON.parse(find("data").textContent);
  const { limits, blocks } = data;
  const STEP_S = 0.04, LEAST_STEPS = 50, THUMB_PX = 16, NEAR_PX = 12, SCALE_PX = 24, BESIDE = "#767676";

  // ---- data -------------------------------------------------------------------------------------------------------
  async function opened(own) { // a run with its paths and impacts as arrays
    const { paths, impacts } = own, first = starts(paths.counts), points = first.at(-1), raw = await unpacked(paths.points);
    const [t, x, y] = columns(raw, paths.scales, paths.steps, points), arc = new Uint8Array(raw, 6 * points, points);
    const firstImpact = starts(impacts.counts), count = firstImpact.at(-1), rows = await unpacked(impacts.rows);
    const impactColumns = impacts.columns.map((_, i) => new Float32Array(rows, 4 * i * count, count));
    const impactZone = new Uint16Array(rows, 4 * impacts.columns.length * count, count);
    const counts = new Uint16Array(await unpacked(own.counts)), upright = own.stations.filter((s) => !s[2]);
    return { ...own, first, t, x, y, arc, firstImpact, impactColumns, impactZone, counts, upright };
  }
  const runs = await Promise.all(data.runs.map(opened)), home = runs[data.shown], { colours } = home;
  let run = home, beside = null; // the run that is shown, and the one that stands beside it
  const drawn = () => (beside ? [beside, run] : [run]);
  function twin(own, other, i) { // the path of the same release of the same block in another run: it starts alike there
    const block = own.paths.block[i], release = own.paths.release[i] - own.first_release[block] + other.first_release[block];
    const found = i < 0 ? -1 : other.paths.release.indexOf(release);
    return other.paths.block[found] === block ? found : -1;
  }

  // ---- state, also in the address ---------------------------------------------------------------------------------
  const state = {};
  function readAddress() {
    const said = live.address();
    run = runs[whole(said.get("view"), runs.length)] ?? home;
    beside = runs[whole(said.get("beside"), runs.length)] ?? null;
    const at = said.has("x") ? Number(said.get("x")) : null;
    state.station = nearest(Number.isFinite(at) ? at : (limits[0] + limits[1]) / 2);
    state.block = said.has("block") ? numbers(said.get("block"), blocks.length) : every(blocks.length);
    state.stop = said.has("stop") ? numbers(said.get("stop"), data.stops.length) : every(data.stops.length);
    state.worst = said.get("worst") === "1";
    state.quantity = whole(said.get("quantity"), data.curve_labels.length) || 0;
    state.path = said.has("release") ? run.paths.release.indexOf(Number(said.get("release"))) : -1;
  }
  const writeAddress = () => live.writeAddress(() => ({
    x: +run.stations[state.station][0].toPrecision(8),
    ...(run !== home && { view: runs.indexOf(run) }),
    ...(beside && { beside: runs.indexOf(beside) }),
    ...(state.block.size < blocks.length && { block: sorted(state.block).join() }),
    ...(state.stop.size < data.stops.length && { stop: sorted(state.stop).join() }),
    ...(state.worst && { worst: 1 }),
    ...(state.quantity && { quantity: state.quantity }),
    ...(state.path >= 0 && { release: run.paths.release[state.path] }),
  }));
  function nearest(at, own = run) { // of equally near ones the measure line
    const miss = (s) => Math.abs(s[0] - at) - (s[2] ? 1e-9 : 0);
    return own.stations.reduce((best, s, i) => (miss(s) < miss(own.stations[best]) ? i : best), 0);
  }
  const shown = (i, { paths } = run) => state.block.has(paths.block[i]) && state.stop.has(paths.stop[i]) && (!state.worst || paths.worst[i]);

  // ---- the section ------------------------------------------------------------------------------------------------
  const stage = find("stage"), [ground, ways, top] = stage.children;
  const view = new live.View(stage, limits);
  const px = (at) => view.x(at), py = (at) => view.y(at);
  function fit() {
    view.fit();
    const wide = (limits[1] - limits[0]) * view.scale;
    slider.style.marginLeft = `${view.left - THUMB_PX / 2}px`;
    slider.style.width = `calc(100% - ${stage.clientWidth - wide - THUMB_PX}px)`;
  }
  function trace(pen, { paths, first, t, x, y, arc }, i) {
    const end = first[i + 1] - 1;
    pen.moveTo(px(x[first[i]]), py(y[first[i]]));
    for (let j = first[i]; j < end; j++) {
      const [x1, y1] = [px(x[j + 1]), py(y[j + 1])];
      if (arc[j]) {
        const sag = (paths.gravity * (t[j + 1] - t[j]) ** 2) / 4;
        pen.quadraticCurveTo(px((x[j] + x[j + 1]) / 2), py((y[j] + y[j + 1]) / 2 + sag), x1, y1);
      } else pen.lineTo(x1, y1);
    }
  }
  function drawPaths() {
    ways.hidden = state.path >= 0;
    if (ways.hidden) return;
    const pen = cleared(ways), counts = [];
    for (const own of drawn()) {
      const all = own.paths.release.map((_, i) => i).filter((i) => shown(i, own));
      pen.globalAlpha = Math.min(Math.max(100 / all.length, 0.1), 0.8);
      for (const i of all) {
        pen.strokeStyle = own === run ? blocks[own.paths.block[i]].colour : BESIDE;
        pen.beginPath();
        trace(pen, own, i);
        pen.stroke();
      }
      counts.unshift(`${all.length} of ${own.paths.release.length} paths shown`);
    }
    said(beside ? `${counts[0]}; grey, ${beside.name}: ${counts[1]}` : counts[0]);
  }
  function place({ paths, first, t, x, y, arc }, i, time) { // of a path at a time
    let j = first[i];
    while (j < first[i + 1] - 2 && t[j + 1] <= time) j++;
    const lasts = t[j + 1] - t[j], share = lasts > 0 ? Math.min(Math.max((time - t[j]) / lasts, 0), 1) : 1;
    const sag = arc[j] ? 0.5 * paths.gravity * lasts ** 2 * share * (1 - share) : 0;
    return [x[j] + share * (x[j + 1] - x[j]), y[j] + share * (y[j + 1] - y[j]) + sag];
  }
  function drawTop() {
    const pen = cleared(top), at = px(run.stations[state.station][0]);
    pen.strokeStyle = colours.ink;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(at, view.top);
    pen.lineTo(at, view.bottom);
    pen.stroke();
    if (state.path < 0) return;
    for (const own of drawn()) {
      const i = twin(run, own, state.path), block = own.paths.block[i];
      if (i < 0) continue;
      pen.strokeStyle = pen.fillStyle = own === run ? blocks[block].colour : BESIDE;
      pen.beginPath();
      trace(pen, own, i);
      pen.stroke();
      const [bx, by] = place(own, i, player.time);
      pen.beginPath();
      pen.arc(px(bx), py(by), Math.max(own.radius[block] * view.scale, 5), 0, 2 * Math.PI);
      pen.fill();
    }
  }

  // ---- the collector ----------------------------------------------------------------------------------------------
  const slider = find("station");
  function also(cell, text) { // the number of the run that stands beside
    cell.appendChild(document.createElement("small")).textContent = text;
  }
  function fillTable() {
    const [at, zone, measured] = run.stations[state.station], there = beside && nearest(at, beside);
    const words = `x = ${fixed(at, view.decimals)} m, ${zone}${measured ? `, measure line: ${measured}` : ""}`;
    find("place").textContent = words;
    slider.value = state.station;
    slider.setAttribute("aria-valuetext", words);
    find("tables").replaceChildren(...sorted(state.block).map((b) => {
      const [passed, frequency, values] = run.texts[b][state.station], table = document.createElement("table");
      const other = beside && beside.texts[b][there];
      table.className = "cells";
      table.createCaption().textContent = `${blocks[b].name}: ${passed} past, ${frequency} of the released`;
      table.caption.prepend(swatch(blocks[b].colour));
      if (other) also(table.caption, `${beside.name}: ${other[0]} past, ${other[1]}`);
      row(table.createTHead(), ["", ...data.percentiles], "th");
      const body = table.createTBody();
      data.quantities.forEach((name, q) => {
        const made = row(body, [name, ...values[q]]);
        if (other) other[2][q].forEach((text, k) => also(made.cells[k + 1], text));
      });
      return table;
    }));
  }
  const curve = find("curve"), histogram = find("histogram"), DASHES = [[2, 2], [], [7, 3]];
  const largest = (rows) => Math.max(...rows.flat(2).filter((v) => v !== null), 0);
  function axes(pen, height, most, label) { // of a small graph as wide as the section; returns where a value lies
    const low = height - 8, high = 24, qy = (v) => low - ((low - high) * v) / most;
    pen.fillStyle = colours.ink;
    pen.fillText(label, view.left + 4, high - 12);
    pen.textAlign = "right";
    for (const v of ticks(0, most, 4)) {
      pen.fillText(`${v}`, view.left - 6, qy(v) + 4);
      pen.fillRect(view.left - 4, qy(v), 4, 1);
    }
    pen.fillRect(view.left, low, px(limits[1]) - view.left, 1);
    return qy;
  }
  function drawCurve() {
    const pen = cleared(curve), q = state.quantity, all = drawn();
    const qy = axes(pen, curve.clientHeight, largest(all.map((own) => sorted(state.block).map((b) => own.curves[q][b]).flat())) || 1, data.curve_labels[q]);
    for (const own of all)
      for (const b of state.block) {
        const lines = own.curves[q][b];
        pen.strokeStyle = pen.fillStyle = own === run ? blocks[b].colour : BESIDE;
        if (q === 0) {
          pen.globalAlpha = 0.2;
          pen.beginPath();
          own.upright.forEach((s, i) => pen.lineTo(px(s[0]), qy(lines[1][i])));
          own.upright.toReversed().forEach((s, i) => pen.lineTo(px(s[0]), qy(lines[2].at(-1 - i))));
          pen.fill();
          pen.globalAlpha = 1;
        }
        (q === 0 ? [lines[0]] : lines).forEach((values, k) => {
          pen.setLineDash(q === 0 ? [] : DASHES[k]);
          pen.beginPath();
          let on = false;
          values.forEach((v, i) => {
            if (v !== null) on ? pen.lineTo(px(own.upright[i][0]), qy(v)) : pen.moveTo(px(own.upright[i][0]), qy(v));
            on = v !== null;
          });
          pen.stroke();
        });
        pen.setLineDash([]);
      }
    pen.fillStyle = colours.ink;
    pen.fillRect(px(run.stations[state.station][0]) - 1, 24, 2, curve.clientHeight - 32);
    const dashes = ["dotted", "line", "dashed"].map((word, k) => `${word}: ${data.percentiles[k]}`).join(", ");
    find("key").textContent = q === 0 ? "band: 95\u00a0% interval" : dashes;
    drawHistogram();
  }
  function bars(own, station, b) { // how many blocks in each bin of the chosen quantity, and the upper end of the last
    const start = ((station * data.quantities.length + state.quantity - 1) * blocks.length + b) * data.bins;
    return [own.counts.subarray(start, start + data.bins), own.ends[station][state.quantity - 1]];
  }
  function drawHistogram() {
    const chosen = state.quantity ? sorted(state.block).map((b) => [b, ...bars(run, state.station, b)]) : [];
    const most = largest(chosen.map(([, counts]) => [...counts])), left = view.left, wide = (px(limits[1]) - left) / data.bins;
    histogram.hidden = !most;
    if (!most) return;
    const end = chosen[0][2], pen = cleared(histogram), low = histogram.clientHeight - SCALE_PX;
    const qy = axes(pen, low + 8, most, `blocks that come past at x = ${fixed(run.stations[state.station][0], view.decimals)} m`);
    pen.textAlign = "center";
    for (const v of ticks(0, end, 8)) if (left + (v / end) * data.bins * wide < px(limits[1]) - 95) pen.fillText(`${v}`, left + (v / end) * data.bins * wide, low + 15);
    pen.textAlign = "right";
    pen.fillText(data.curve_labels[state.quantity], px(limits[1]), low + 15);
    chosen.forEach(([b, counts], k) => {
      pen.fillStyle = blocks[b].colour;
      const own = (wide - 2) / chosen.length;
      counts.forEach((n, i) => pen.fillRect(left + i * wide + 1 + k * own, qy(n), own, low - qy(n)));
    });
  }

  // ---- one release ------------------------------------------------------------------------------------------------
  const said = (words) => { find("said").textContent = words; };
  const clock = find("time");
  const step = () => Math.min(STEP_S, (clock.max - clock.min) / LEAST_STEPS);
  const parts = { clock, play: find("play"), back: find("back"), on: find("on"), speed: find("speed") };
  const player = new live.Player(parts, (time, way) => time + way * step(), drawTop);
  const digits = (v) => (Number.isFinite(v) ? `${+v.toPrecision(3)}` : "-");
  function fillRelease() {
    const { paths, impacts, first, t } = run;
    player.pause();
    find("one").hidden = state.path < 0;
    find("release").value = state.path < 0 ? "" : paths.release[state.path];
    if (state.path < 0) return;
    player.range(t[first[state.path]], t[first[state.path + 1] - 1]);
    const release = paths.release[state.path], i = impacts.release.indexOf(release);
    said(`release ${release}, ${blocks[paths.block[state.path]].name}, ${data.stops[paths.stop[state.path]]}; `
      + `starts at x = ${digits(run.x[first[state.path]])} m, y = ${digits(run.y[first[state.path]])} m; `
      + `largest energy ${paths.energy[state.path]} ${data.energy_unit}`);
    const own = find("impacts");
    own.tHead.replaceChildren();
    own.tBodies[0].replaceChildren();
    own.caption.textContent = i < 0 ? "Impacts: not on this page" : `Impacts: ${impacts.counts[i]}`;
    if (i < 0) return;
    row(own.tHead, ["zone", ...impacts.columns], "th");
    for (let k = run.firstImpact[i]; k < run.firstImpact[i + 1]; k++)
      row(own.tBodies[0], [impacts.zones[run.impactZone[k]], ...run.impactColumns.map((column) => digits(column[k]))]);
  }
  function pathNear(mx, my) {
    const { paths, first, t, x, y, arc } = run;
    let best = NEAR_PX, found = -1;
    for (let i = 0; i < paths.release.length; i++) {
      if (!shown(i)) continue;
      for (let j = first[i]; j < first[i + 1] - 1; j++) {
        const pieces = arc[j] ? 6 : 1, drop = arc[j] ? 0.5 * paths.gravity * (t[j + 1] - t[j]) ** 2 : 0;
        let [ax, ay] = [px(x[j]), py(y[j])];
        for (let k = 1; k <= pieces; k++) {
          const s = k / pieces, bx = px(x[j] + s * (x[j + 1] - x[j]));
          const by = py(y[j] + s * (y[j + 1] - y[j]) + drop * s * (1 - s));
          const length = (bx - ax) ** 2 + (by - ay) ** 2;
          const along = length ? Math.min(Math.max(((mx - ax) * (bx - ax) + (my - ay) * (by - ay)) / length, 0), 1) : 0;
          const miss = Math.hypot(ax + along * (bx - ax) - mx, ay + along * (by - ay) - my);
          if (miss < best) [best, found] = [miss, i];
          [ax, ay] = [bx, by];
        }
      }
    }
    return found;
  }

  // ---- controls ---------------------------------------------------------------------------------------------------
  let asked = 0;
  function moveTo(station) {
    state.station = station;
    if (!asked) asked = requestAnimationFrame(() => { asked = 0; fillTable(); drawTop(); drawCurve(); });
    writeAddress();
  }
  function choose(path) {
    state.path = path;
    fillRelease();
    drawPaths();
    if (path >= 0) player.set(run.t[run.first[path]]);
    else drawTop();
    writeAddress();
  }
  const boxes = (name) => [...section.querySelectorAll(`input[name=${name}]`)];
  function chooseRuns(own, other) { // the collector and the release stay where they are
    const at = run.stations[state.station][0];
    state.path = twin(run, own, state.path);
    [run, beside] = [own, other === own ? null : other];
    state.station = nearest(at);
    showState();
    writeAddress();
  }
  function drawAll() {
    slider.max = run.stations.length - 1;
    find("thinned").textContent = run.notes.join(" ");
    view.decimals = Math.max(0, 2 - Math.floor(Math.log10(limits[1] - limits[0]) - 1));
    fit();
    const pen = cleared(ground);
    view.scene(pen, run);
    if (beside && `${beside.ground}` !== `${run.ground}`) {
      pen.strokeStyle = BESIDE;
      view.clip(pen);
      view.line(pen, beside.ground);
      pen.stroke();
    }
    drawPaths();
    fillTable();
    drawTop();
    drawCurve();
  }
  function showState() {
    for (const name of ["block", "stop"]) for (const box of boxes(name)) box.checked = state[name].has(Number(box.value));
    find("worst").checked = state.worst;
    find("quantity").value = state.quantity;
    if (runs.length > 1) {
      find("view").value = runs.indexOf(run);
      find("view").setAttribute("aria-valuetext", run.name);
      find("beside").value = runs.indexOf(beside);
      find("viewed").textContent = [run.name, run.note].filter(Boolean).join(": ");
    }
    fillRelease();
    drawAll();
    if (state.path >= 0) player.set(run.t[run.first[state.path]]);
  }
  const at = (event) => view.at(event);
  stage.addEventListener("pointermove", (event) => moveTo(nearest(limits[0] + (at(event)[0] - view.left) / view.scale)));
  stage.addEventListener("click", (event) => choose(pathNear(...at(event))));
  slider.addEventListener("input", () => moveTo(Number(slider.value)));
  if (runs.length > 1) {
    find("view").addEventListener("input", (event) => chooseRuns(runs[event.target.value], beside));
    find("beside").addEventListener("change", (event) => chooseRuns(run, runs[event.target.value] ?? null));
  }
  for (const name of ["block", "stop"])
    for (const box of boxes(name))
      box.addEventListener("change", () => {
        state[name][box.checked ? "add" : "delete"](Number(box.value));
        state.path = -1;
        fillRelease();
        drawAll();
        writeAddress();
      });
  boxes("block").forEach((box, b) => box.after(swatch(blocks[b].colour)));
  find("worst").addEventListener("change", (event) => { state.worst = event.target.checked; choose(-1); });
  find("quantity").addEventListener("change", (event) => { state.quantity = Number(event.target.value); drawCurve(); writeAddress(); });
  find("release").addEventListener("change", (event) => {
    const path = event.target.value === "" ? -1 : run.paths.release.indexOf(Number(event.target.value)), wanted = event.target.value;
    choose(path);
    if (path < 0 && wanted !== "") said(`the page holds no path of release ${wanted}`);
  });
  find("all").addEventListener("click", () => choose(-1));
  find("largest").addEventListener("click", () => {
    const { energy } = run.paths, all = energy.map((_, i) => i).filter((i) => shown(i));
    choose(all.reduce((best, i) => (best < 0 || energy[i] > energy[best] ? i : best), -1));
  });
  window.addEventListener("hashchange", () => { readAddress(); showState(); });
  section.hidden = false;
  readAddress();
  showState();
  live.whenResized(stage, drawAll);
})();
