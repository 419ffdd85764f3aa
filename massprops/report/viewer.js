// Meshes to turn: drag, wheel or pinch, arrow keys; Shift, the right button or two fingers move them. One viewer for every
// element of class "viewer"; its data is the JSON beside it (massprops/report/viewer.py). Orthographic, flat shading, no
// library.
"use strict";
document.querySelectorAll(".viewer").forEach((host) => {
  const canvas = host.querySelector("canvas");
  const gl = canvas.getContext("webgl", { antialias: true, alpha: true, preserveDrawingBuffer: true });
  if (!gl) { host.querySelector(".note").hidden = false; return; }
  const data = JSON.parse(host.querySelector("script").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  // ---- geometry: lists of position (3), normal (3), colour (3) for each corner
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((x) => x / l); };
  const add = (a, b, s) => a.map((x, i) => x + s * b[i]);
  const MEASURED = [0.74, 0.77, 0.80], FILLED = [0.86, 0.20, 0.16], INFERRED = [0.04, 0.52, 0.89], CENTRE = [0.98, 0.78, 0.18];
  const AXES = [[0.95, 0.45, 0.15], [0.25, 0.70, 0.35], [0.30, 0.55, 0.98]];

  const mixed = (from, to, x) => from.map((v, c) => v + x * (to[c] - v));
  const ON = [0.96, 0.96, 0.96], OUTSIDE = [0.745, 0.118, 0.176], INSIDE = [0.137, 0.314, 0.667], FEW = [0.984, 0.906, 0.698], MANY = [0.078, 0.408, 0.549];
  function meshCorners(mode) {
    const q = new Int16Array(bytes(data.vertices).buffer), raw = bytes(data.faces).buffer;
    const faces = data.wide ? new Uint32Array(raw) : new Uint16Array(raw);
    const of = (name, use) => (use && data[name] ? bytes(data[name]) : null);
    const flags = of("filled", mode === "measured"), closed = of("inferred", mode === "measured"), rgb = of("rgb", mode === "colour"), seen = of("seenIn", mode === "images");
    const distance = mode === "deviation" && data.distance ? new Int8Array(bytes(data.distance).buffer) : null;
    const out = new Float32Array(9 * faces.length);
    const at = (v, plain) => {
      if (distance) { const x = distance[v] / 127; return mixed(ON, x > 0 ? OUTSIDE : INSIDE, Math.abs(x)); }
      if (seen) return seen[v] === 0 ? FILLED : mixed(FEW, MANY, Math.min(1, (seen[v] - 1) / (data.mostImages - 1)));
      return rgb ? [0, 1, 2].map((c) => rgb[3 * v + c] / 255) : plain;
    };
    for (let f = 0; f < faces.length; f += 3) {
      const p = [0, 1, 2].map((k) => [0, 1, 2].map((c) => q[3 * faces[f + k] + c] / 32767));
      const n = unit(cross(add(p[1], p[0], -1), add(p[2], p[0], -1))), face = f / 3;
      const marked = (bits) => bits && (bits[face >> 3] >> (face & 7)) & 1;
      const plain = marked(flags) ? FILLED : marked(closed) ? INFERRED : MEASURED;
      for (let k = 0; k < 3; k++) out.set([...p[k], ...n, ...at(faces[f + k], plain)], 9 * (f + k));
    }
    return out;
  }
  function rod(a, b, radius, colour, out) {
    const along = unit(add(b, a, -1)), side = unit(cross(along, Math.abs(along[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0])), up = cross(along, side), sides = 10;
    const rim = (i) => { const t = (2 * Math.PI * i) / sides; return add(side.map((x) => x * Math.cos(t)), up, Math.sin(t)); };
    for (let i = 0; i < sides; i++) {
      const m = rim(i), n = rim(i + 1), corner = (at, r) => [...add(at, r, radius), ...r, ...colour];
      out.push(...corner(a, m), ...corner(b, m), ...corner(b, n), ...corner(a, m), ...corner(b, n), ...corner(a, n));
    }
  }
  function ball(at, radius, colour, out) {
    const on = (i, j) => { const u = (Math.PI * i) / 8, v = (Math.PI * j) / 8, n = [Math.sin(u) * Math.cos(v), Math.sin(u) * Math.sin(v), Math.cos(u)]; return [...add(at, n, radius), ...n, ...colour]; };
    for (let i = 0; i < 8; i++) for (let j = 0; j < 16; j++) out.push(...on(i, j), ...on(i + 1, j), ...on(i + 1, j + 1), ...on(i, j), ...on(i + 1, j + 1), ...on(i, j + 1));
  }
  const frame = [];
  data.axes.forEach((axis, i) => rod(add(data.centre, axis, -1.05), add(data.centre, axis, 1.05), 0.007, AXES[i], frame));
  (data.others || []).forEach((axis, i) => rod(add(data.centre, axis, -1.2), add(data.centre, axis, 1.2), 0.0035, AXES[i].map((x) => 0.55 * x), frame));
  if (data.centre) ball(data.centre, 0.028, CENTRE, frame);
  const path = [], lines = [];
  data.frusta.forEach(([c, ...corners], i) => {
    const t = i / Math.max(1, data.frusta.length - 1), colour = [0.15 + 0.75 * t, 0.45, 0.85 - 0.7 * t], end = (p) => [...p, 0, 0, 0, ...colour];
    path.push(...end(c));
    corners.forEach((p, k) => lines.push(...end(c), ...end(p), ...end(p), ...end(corners[(k + 1) % 4])));
  });
  const dots = [];
  if (data.points) {
    const q = new Int16Array(bytes(data.points).buffer), rgb = bytes(data.pointColours);
    for (let i = 0; i < q.length; i += 3) dots.push(q[i] / 16383, q[i + 1] / 16383, q[i + 2] / 16383, 0, 0, 0, rgb[i] / 255, rgb[i + 1] / 255, rgb[i + 2] / 255);
  }
  const triad = [], TRIAD = [[0.85, 0.2, 0.2], [0.2, 0.6, 0.25], [0.2, 0.4, 0.9]];
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, i) => rod([0, 0, 0], axis, 0.06, TRIAD[i], triad));

  // ---- WebGL
  const shader = (kind, source) => { const s = gl.createShader(kind); gl.shaderSource(s, source); gl.compileShader(s); return s; };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, "attribute vec3 p,n,c;uniform mat4 M;uniform mat3 R;uniform float size;varying vec3 v,k;void main(){gl_Position=M*vec4(p,1.);gl_PointSize=size;v=R*n;k=c;}"));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, "precision mediump float;varying vec3 v,k;uniform float lit,alpha;void main(){vec3 d=normalize(v+vec3(0.,0.,1e-5));float s=.36+.60*max(dot(d,normalize(vec3(.35,.55,.9))),0.)+.16*max(dot(d,normalize(vec3(-.8,-.1,.4))),0.);gl_FragColor=vec4(k*mix(1.,s,lit)*alpha,alpha);}"));
  gl.linkProgram(program); gl.useProgram(program);
  gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  const uniform = {}; ["M", "R", "lit", "alpha", "size"].forEach((name) => { uniform[name] = gl.getUniformLocation(program, name); });
  const place = ["p", "n", "c"].map((name) => gl.getAttribLocation(program, name));
  const upload = (list) => { const b = gl.createBuffer(); gl.bindBuffer(gl.ARRAY_BUFFER, b); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list), gl.STATIC_DRAW); return { b, count: list.length / 9 }; };
  const paint = (set, mode, lit, alpha) => {
    if (!set.count) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, set.b);
    place.forEach((at, i) => { gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 36, 12 * i); });
    gl.uniform1f(uniform.lit, lit); gl.uniform1f(uniform.alpha, alpha); gl.drawArrays(mode, 0, set.count);
  };
  const first = host.querySelector("[data-mode]"), modes = [...host.querySelectorAll("[data-mode]")];
  let mode = first ? first.dataset.mode : data.rgb ? "colour" : "measured";
  let body = upload(meshCorners(mode));
  const sets = { frame: upload(frame), path: upload(path), lines: upload(lines), dots: upload(dots), triad: upload(triad) };

  // ---- view
  const multiply = (A, B) => A.map((r) => [0, 1, 2].map((j) => r[0] * B[0][j] + r[1] * B[1][j] + r[2] * B[2][j]));
  // the start looks from 30 degrees to the right and 25 above, z up: of the principal frame where it is known, since the axes of
  // a reconstruction lie anyhow
  const [ca, sa, ce, se] = [Math.cos(Math.PI / 6), Math.sin(Math.PI / 6), Math.cos(0.436), Math.sin(0.436)];
  const right = [ca, sa, 0], toward = [sa * ce, -ca * ce, se], above = [right, cross(toward, right), toward];
  const VIEWS = {
    reset: data.axes.length === 3 ? multiply(above, data.axes) : above,
    front: [[1, 0, 0], [0, 0, 1], [0, -1, 0]], side: [[0, 1, 0], [0, 0, 1], [1, 0, 0]], top: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  };
  let R = VIEWS.reset, zoom = 1, pan = [0, 0];
  const show = { axes: true, cameras: false, cloud: false };
  const label = (text, colour) => { const e = document.createElement("span"); e.className = "label"; e.setAttribute("aria-hidden", "true"); e.textContent = text; e.style.color = `rgb(${colour.map((x) => Math.round(220 * x))})`; host.querySelector(".stage").appendChild(e); return e; };
  const labels = data.axes.map((_, i) => label("I" + (i + 1), AXES[i])), corner = ["x", "y", "z"].map((name, i) => label(name, TRIAD[i]));
  const matrix = (rows, at) => gl.uniformMatrix4fv(uniform.M, false, [0, 1, 2].flatMap((c) => [rows[0][c], rows[1][c], rows[2][c], 0]).concat([at[0], at[1], 0, 1]));
  function draw() {  // pointer events come once a frame: no need to wait for one
    const w = canvas.clientWidth, h = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    if (!w || !h) return;
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0); gl.enable(gl.DEPTH_TEST); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const reach = show.cameras ? data.reach : 1.0, s = zoom / (1.08 * reach);
    const rows = [R[0].map((x) => x * s * Math.min(1, h / w)), R[1].map((x) => x * s * Math.min(1, w / h)), R[2].map((x) => (-x * 0.5) / data.reach)];
    matrix(rows, pan);
    gl.uniformMatrix3fv(uniform.R, false, [0, 1, 2].flatMap((j) => R.map((r) => r[j])));
    gl.uniform1f(uniform.size, 2 * ratio);
    if (show.cloud) paint(sets.dots, gl.POINTS, 0, 1); else paint(body, gl.TRIANGLES, 1, 1);
    if (show.axes) { paint(sets.frame, gl.TRIANGLES, 1, 1); gl.disable(gl.DEPTH_TEST); paint(sets.frame, gl.TRIANGLES, 0, 0.22); gl.enable(gl.DEPTH_TEST); }
    if (show.cameras) { paint(sets.path, gl.LINE_STRIP, 0, 0.7); paint(sets.lines, gl.LINES, 0, 0.9); }
    const side = 72, inner = 0.62;  // the mesh's own axes, in the corner
    gl.viewport(4 * ratio, 4 * ratio, side * ratio, side * ratio); gl.clear(gl.DEPTH_BUFFER_BIT);
    matrix([R[0].map((x) => inner * x), R[1].map((x) => inner * x), R[2].map((x) => -0.4 * x)], [0, 0]);
    paint(sets.triad, gl.TRIANGLES, 1, 1);
    corner.forEach((e, i) => { e.style.left = `${4 + side * (0.5 + 0.5 * 0.85 * R[0][i])}px`; e.style.top = `${h - 4 - side * (0.5 + 0.5 * 0.85 * R[1][i])}px`; });
    labels.forEach((e, i) => {
      const p = add(data.centre, data.axes[i], 1.1);
      e.hidden = !show.axes;
      e.style.left = `${(0.5 + 0.5 * (pan[0] + rows[0].reduce((t, x, c) => t + x * p[c], 0))) * w}px`;
      e.style.top = `${(0.5 - 0.5 * (pan[1] + rows[1].reduce((t, x, c) => t + x * p[c], 0))) * h}px`;
    });
  }

  // ---- hands
  const turn = (dx, dy) => {
    const [cx, sx, cy, sy] = [Math.cos(dy), Math.sin(dy), Math.cos(dx), Math.sin(dx)];
    R = multiply([[1, 0, 0], [0, cx, -sx], [0, sx, cx]], multiply([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]], R));
    const z = unit(R[2]), x = unit(add(R[0], z, -(R[0][0] * z[0] + R[0][1] * z[1] + R[0][2] * z[2])));
    R = [x, cross(z, x), z]; draw();
  };
  const come = (factor) => { zoom = Math.min(40, Math.max(0.2, zoom * factor)); draw(); };
  const move = (dx, dy) => { pan = [Math.max(-3, Math.min(3, pan[0] + (2 * dx) / canvas.clientWidth)), Math.max(-3, Math.min(3, pan[1] - (2 * dy) / canvas.clientHeight))]; draw(); };
  const fingers = new Map(); let apart = 0;
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("pointerdown", (e) => { fingers.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); });
  ["pointerup", "pointercancel"].forEach((kind) => canvas.addEventListener(kind, (e) => { fingers.delete(e.pointerId); apart = 0; }));
  canvas.addEventListener("pointermove", (e) => {
    const before = fingers.get(e.pointerId); if (!before) return;
    const dx = e.clientX - before[0], dy = e.clientY - before[1];
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (fingers.size === 2) { const [a, b] = [...fingers.values()], d = Math.hypot(a[0] - b[0], a[1] - b[1]); if (apart) come(d / apart); apart = d; move(dx / 2, dy / 2); }
    else if (e.shiftKey || e.buttons & 6) move(dx, dy);
    else if (fingers.size === 1) turn(dx * 0.008, dy * 0.008);
  });
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); come(Math.exp(-e.deltaY * 0.0012)); }, { passive: false });
  const KEYS = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.12], ArrowDown: [0, 0.12] };
  canvas.addEventListener("keydown", (e) => {
    if (KEYS[e.key]) { if (e.shiftKey) move(...KEYS[e.key].map((x) => 250 * x)); else turn(...KEYS[e.key]); e.preventDefault(); } else if (e.key === "+") come(1.15); else if (e.key === "-") come(1 / 1.15);
  });
  host.querySelectorAll("[data-view]").forEach((b) => b.addEventListener("click", () => { stop(); R = VIEWS[b.dataset.view]; zoom = 1; pan = [0, 0]; if (film) film.hidden = true; draw(); }));
  host.querySelectorAll("[data-show]").forEach((box) => box.addEventListener("change", () => { show[box.dataset.show] = box.checked; draw(); }));
  const press = (b, on) => b.setAttribute("aria-pressed", on ? "true" : "false");
  modes.forEach((b) => b.addEventListener("click", () => {
    mode = b.dataset.mode; modes.forEach((other) => press(other, other === b));
    host.querySelectorAll("[data-keys]").forEach((p) => { p.hidden = p.dataset.keys !== mode; });
    gl.deleteBuffer(body.b); body = upload(meshCorners(mode)); draw();
  }));

  // ---- the motion, as the camera saw it, beside the footage
  const film = host.querySelector(".film"), play = host.querySelector("[data-play]"), time = host.querySelector("input[type=range]");
  let running = 0;
  const begin = play && play.textContent;
  const stop = () => { if (running) { clearInterval(running); running = 0; press(play, false); play.textContent = begin; } };
  const at = (i) => {
    const f = data.film[i];
    // a camera looks along +z with y down; the page looks along -z with y up
    R = [f.R[0], f.R[1].map((x) => -x), f.R[2].map((x) => -x)];
    film.src = f.image; film.hidden = false; time.value = i; host.querySelector("output").textContent = f.label; draw();
  };
  if (play) {
    time.addEventListener("input", () => { stop(); at(Number(time.value)); });
    play.addEventListener("click", () => {
      if (running) { stop(); return; }
      press(play, true); play.textContent = "stop";
      running = setInterval(() => at((Number(time.value) + 1) % data.film.length), 120);
    });
  }
  new ResizeObserver(draw).observe(canvas);
  draw();
});
