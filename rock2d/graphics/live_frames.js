// The live view of a tracked film: shows the frames that tracking/rock2d_tracking/live_frames.py has prepared.
(() => {
  const find = (id) => document.getElementById(`live-${id}`), section = document.getElementById("live");
  if (!live.able()) return;
  const data = JSON.parse(find("data").textContent);
  const { frames, releases, blocks, pictures, size } = data;
  const NEAR_RADII = 3, LEAST_NEAR_PX = 20, DOT_SHARE = 1 / 220, SOON_S = 1e-9;
  const first = live.starts(releases.map((own) => own[2])), t = frames.t_s;
  const pictureOf = new Map(pictures.rows.map((row, i) => [row, i]));
  const set = (node, names) => { for (const [name, value] of Object.entries(names)) node.setAttribute(name, value); return node; };
  const drawn = (name, names) => set(document.createElementNS(film.namespaceURI, name), names);
  const source = (text) => `data:image/webp;base64,${text}`;

  // ---- state, also in the address ---------------------------------------------------------------------------------
  const state = { release: 0, row: 0 };
  const writeAddress = () => live.writeAddress(() => ({ release: releases[state.release][0], frame: frames.frame[state.row] }));
  function readAddress() {
    const said = live.address();
    const release = releases.findIndex((own) => own[0] === Number(said.get("release") ?? releases[0][0]));
    state.release = Math.max(release, 0);
    const wanted = said.has("frame") ? Number(said.get("frame")) : -Infinity;
    state.row = rows().find((row) => frames.frame[row] >= wanted) ?? first[state.release + 1] - 1;
  }
  const rows = () => Array.from({ length: releases[state.release][2] }, (_, i) => first[state.release] + i);
  const lost = (row) => data.reasons[frames.reason[row]][0] !== "";

  // ---- what is said of a frame ------------------------------------------------------------------------------------
  const seconds = (row) => `${+t[row].toPrecision(6)}`;
  const number = (value, digits) => (value === null ? "-" : live.fixed(value, digits));
  const error = (value) => (value === null ? "-" : `${+value.toPrecision(2)}`);
  const degrees = (value) => (value === null ? null : (value * 180) / Math.PI);
  function why(row) {
    const [reason, meaning] = data.reasons[frames.reason[row]], block = blocks[releases[state.release][1]];
    if (reason) return `lost: ${reason}. ${meaning}`;
    const worst = Math.max(frames.u_error_px[row] ?? 0, frames.v_error_px[row] ?? 0);
    return `trusted: ${number(100 * frames.confidence[row], 0)}\u00a0% ${block.how}; ` +
      `its standard error of ${error(worst)} px is below the limit of ${block.limit} px, and it agrees with its neighbours`;
  }
  function facts(row) {
    const turned = degrees(frames.theta_rad[row]), off = degrees(frames.angle_error_rad[row]);
    return [
      ["why", why(row)],
      ["frame, time", `frame ${frames.frame[row]} of the film, ${seconds(row)} s after the first of this release`],
      ["in the picture", `u = ${number(frames.u_px[row], 2)} ± ${error(frames.u_error_px[row])} px, ` +
        `v = ${number(frames.v_px[row], 2)} ± ${error(frames.v_error_px[row])} px`],
      ["in metres", lost(row) ? "not trusted" : `x = ${number(frames.x_m[row], 4)} m, y = ${number(frames.y_m[row], 4)} m`],
      ["angle", lost(row) ? "not trusted" : turned === null ? "not measured" : `${live.fixed(turned, 1)}° ± ${error(off)}°`],
      ["flight", data.flights[frames.flight[row]] ?? "none: too near an impact, or too short"],
      ["impact", data.impacts[frames.impact[row]] ?? "none"],
    ];
  }

  // ---- pictures ---------------------------------------------------------------------------------------------------
  const near = find("near"), film = find("film"), [still, dots, box] = film.children, [cut, outline] = near.children;
  set(film, { viewBox: `-0.5 -0.5 ${size[0]} ${size[1]}` });
  set(still, { href: source(data.still), x: -0.5, y: -0.5, width: size[0], height: size[1] });
  function place(row) { // of a lost frame: of the nearest one whose place is known
    if (frames.u_px[row] !== null) return [frames.u_px[row], frames.v_px[row]];
    const known = rows().filter((own) => frames.u_px[own] !== null);
    const best = known.reduce((a, b) => (Math.abs(b - row) < Math.abs(a - row) ? b : a));
    return [frames.u_px[best], frames.v_px[best]];
  }
  function drawPath() {
    const radius = Math.max(...size) * DOT_SHARE, seen = rows().filter((row) => frames.u_px[row] !== null);
    seen.sort((a, b) => lost(a) - lost(b)); // lost ones lie on top
    dots.replaceChildren(...seen.map((row) =>
      drawn("circle", { cx: frames.u_px[row], cy: frames.v_px[row], r: radius, class: lost(row) ? "lost" : "seen" })));
  }
  function drawFrame(row) {
    const block = blocks[releases[state.release][1]], i = pictureOf.get(row);
    const reach = Math.max(...block.outline.map(([x, y]) => Math.hypot(x, y)));
    let half = Math.max(NEAR_RADII * reach, LEAST_NEAR_PX), [u, v] = place(row);
    cut.style.display = i === undefined ? "none" : "";
    if (i !== undefined) {
      const [left, top, width, height] = pictures.boxes[i];
      set(cut, { href: source(pictures.images[i]), x: left - 0.5, y: top - 0.5, width, height, preserveAspectRatio: "none" });
      half = Math.max(width, height) / 2;
      if (frames.u_px[row] === null) [u, v] = [left + width / 2, top + height / 2];
    }
    set(near, { viewBox: `${u - half} ${v - half} ${2 * half} ${2 * half}` });
    set(box, { x: u - half, y: v - half, width: 2 * half, height: 2 * half });
    const c = Math.cos(frames.angle_px_rad[row] ?? 0), s = Math.sin(frames.angle_px_rad[row] ?? 0);
    outline.style.display = frames.u_px[row] === null ? "none" : "";
    const corners = block.outline.map(([x, y]) => `${frames.u_px[row] + c * x - s * y},${frames.v_px[row] + s * x + c * y}`);
    set(outline, { points: corners.join(" "), class: lost(row) ? "lost" : "seen" });
    find("caption").textContent = i === undefined ? "This page has no picture of this frame" : `Frame ${frames.frame[row]} about the block`;
  }
  function show(row) {
    state.row = row;
    drawFrame(row);
    const body = find("table").tBodies[0];
    body.replaceChildren();
    for (const [name, text] of facts(row)) {
      const made = live.row(body, [name], "th");
      made.cells[0].scope = "row";
      made.appendChild(document.createElement("td")).textContent = text;
    }
    find("said").setAttribute("aria-live", player.playing ? "off" : "polite");
    find("said").textContent = `Frame ${frames.frame[row]}: ${lost(row) ? "lost" : "trusted"}, ${seconds(row)} s`;
    clock.setAttribute("aria-valuetext", find("said").textContent);
    writeAddress();
  }

  // ---- controls ---------------------------------------------------------------------------------------------------
  const clock = find("time");
  const rowAt = (time) => rows().findLast((row) => t[row] <= time + SOON_S) ?? first[state.release];
  const inside = (row) => Math.min(Math.max(row, first[state.release]), first[state.release + 1] - 1);
  const parts = { clock, play: find("play"), back: find("back"), on: find("on"), speed: find("speed") };
  const player = new live.Player(parts, (time, way) => t[inside(rowAt(time) + way)], (time) => show(pictured(rowAt(time))));
  function pictured(row) { // while the film plays, frames without a picture are passed over
    let shown = row;
    while (player.playing && !pictureOf.has(shown) && shown > first[state.release]) shown--;
    return shown;
  }
  function go(row) {
    player.pause();
    player.set(t[row]);
  }
  function jump(fits, way) {
    const ahead = rows().filter((row) => (row - state.row) * way > 0 && fits(row));
    if (ahead.length) go(way > 0 ? ahead[0] : ahead.at(-1));
    else find("said").textContent = `no further one ${way > 0 ? "after" : "before"} this frame in this release`;
  }
  // the frames of an impact follow one another: a jump goes to the first of them
  const begins = (row) => frames.impact[row] >= 0 && (row === first[state.release] || frames.impact[row - 1] !== frames.impact[row]);
  const jumps = { lost, impact: begins };
  for (const [name, fits] of Object.entries(jumps))
    for (const [side, way] of [["back", -1], ["on", 1]])
      find(`${name}-${side}`).addEventListener("click", () => jump(fits, way));
  function showState() {
    find("release").value = state.release;
    player.range(t[first[state.release]], t[first[state.release + 1] - 1]);
    drawPath();
    player.set(t[state.row]);
  }
  find("release").addEventListener("change", (event) => {
    state.release = Number(event.target.value);
    state.row = first[state.release];
    showState();
  });
  film.addEventListener("click", (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(film.getScreenCTM().inverse());
    const away = (row) => (frames.u_px[row] === null ? Infinity : Math.hypot(frames.u_px[row] - at.x, frames.v_px[row] - at.y));
    go(rows().reduce((a, b) => (away(b) < away(a) ? b : a)));
  });
  const keys = {
    ArrowLeft: () => go(inside(state.row - 1)), ArrowRight: () => go(inside(state.row + 1)),
    Home: () => go(first[state.release]), End: () => go(first[state.release + 1] - 1), " ": () => find("play").click(),
    l: () => jump(lost, 1), L: () => jump(lost, -1), i: () => jump(begins, 1), I: () => jump(begins, -1),
  };
  for (const part of [find("pictures"), clock])
    part.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  window.addEventListener("hashchange", () => { readAddress(); showState(); });
  section.hidden = false;
  readAddress();
  showState();
})();
