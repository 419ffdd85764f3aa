// Turns a mesh with the pointer; wheel or pinch to come closer. Flat shading, principal axes as lines.
"use strict";
(() => {
  const host = document.getElementById("viewer"), canvas = host.querySelector("canvas");
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) { host.textContent = "This browser shows no 3D (WebGL is off)."; return; }
  const bytes = (s) => Uint8Array.from(atob(s), (c) => c.charCodeAt(0));
  const m = JSON.parse(document.getElementById("mesh").textContent);
  const q = new Int16Array(bytes(m.vertices).buffer), faces = new Uint32Array(bytes(m.faces).buffer), seen = bytes(m.observed);
  const n = faces.length, position = new Float32Array(3 * n), normal = new Float32Array(3 * n), colour = new Float32Array(3 * n);
  for (let f = 0; f < n; f += 3) {
    const p = [0, 1, 2].map((k) => [0, 1, 2].map((c) => q[3 * faces[f + k] + c] / 32767));
    const a = [0, 1, 2].map((c) => p[1][c] - p[0][c]), b = [0, 1, 2].map((c) => p[2][c] - p[0][c]);
    const g = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const l = Math.hypot(...g) || 1, paint = seen[f / 3] ? [0.73, 0.76, 0.79] : [0.86, 0.22, 0.18];
    for (let k = 0; k < 3; k++) for (let c = 0; c < 3; c++) {
      position[3 * (f + k) + c] = p[k][c]; normal[3 * (f + k) + c] = g[c] / l; colour[3 * (f + k) + c] = paint[c];
    }
  }
  const line = [], lineColour = [], ink = [[0.95, 0.45, 0.3], [0.45, 0.85, 0.45], [0.45, 0.65, 1.0]];
  m.axes.forEach((axis, i) => { [-1, 1].forEach((s) => { line.push(...axis.map((v, c) => m.centre[c] + s * v)); lineColour.push(...ink[i]); }); });
  const shader = (kind, source) => { const s = gl.createShader(kind); gl.shaderSource(s, source); gl.compileShader(s); return s; };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, "attribute vec3 p,n,c;uniform mat4 M;uniform mat3 R;varying vec3 v,k;void main(){gl_Position=M*vec4(p,1.);v=R*n;k=c;}"));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, "precision mediump float;varying vec3 v,k;uniform float lit;void main(){vec3 d=normalize(v+vec3(1e-6));float s=.30+.62*max(dot(d,normalize(vec3(.4,.6,.9))),0.)+.18*max(dot(d,normalize(vec3(-.7,-.2,.4))),0.);gl_FragColor=vec4(k*mix(1.,s,lit),1.);}"));
  gl.linkProgram(program); gl.useProgram(program);
  const at = (name) => gl.getAttribLocation(program, name), uniform = (name) => gl.getUniformLocation(program, name);
  const buffer = (data) => { const b = gl.createBuffer(); gl.bindBuffer(gl.ARRAY_BUFFER, b); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.STATIC_DRAW); return b; };
  const body = [position, normal, colour].map(buffer), lines = [line, line, lineColour].map(buffer);
  const bind = (set) => ["p", "n", "c"].forEach((name, i) => { gl.bindBuffer(gl.ARRAY_BUFFER, set[i]); gl.enableVertexAttribArray(at(name)); gl.vertexAttribPointer(at(name), 3, gl.FLOAT, false, 0, 0); });
  let R = [[0.80, 0.0, -0.60], [-0.21, 0.94, -0.28], [0.56, 0.35, 0.75]], zoom = 1;
  const mul = (A, B) => A.map((r) => [0, 1, 2].map((j) => r[0] * B[0][j] + r[1] * B[1][j] + r[2] * B[2][j]));
  const labels = m.axes.map((_, i) => { const e = document.createElement("span"); e.className = "label"; e.textContent = "I" + (i + 1); host.appendChild(e); return e; });
  const draw = () => {
    const w = host.clientWidth, h = host.clientHeight, ratio = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(w * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
    gl.viewport(0, 0, canvas.width, canvas.height); gl.clearColor(0.125, 0.149, 0.169, 1); gl.enable(gl.DEPTH_TEST); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const s = zoom * 0.62 * Math.min(1, w / h), sx = s * Math.min(1, h / w) / Math.min(1, w / h), sy = s * Math.max(1, Math.min(w / h, 1)), o = m.middle;
    const rows = [R[0].map((v) => v * sx), R[1].map((v) => v * sy), R[2].map((v) => -v * 0.25)];
    const shift = rows.map((r) => -(r[0] * o[0] + r[1] * o[1] + r[2] * o[2]));
    const M = [rows[0][0], rows[1][0], rows[2][0], 0, rows[0][1], rows[1][1], rows[2][1], 0, rows[0][2], rows[1][2], rows[2][2], 0, shift[0], shift[1], shift[2], 1];
    gl.uniformMatrix4fv(uniform("M"), false, M); gl.uniformMatrix3fv(uniform("R"), false, [R[0][0], R[1][0], R[2][0], R[0][1], R[1][1], R[2][1], R[0][2], R[1][2], R[2][2]]);
    bind(body); gl.uniform1f(uniform("lit"), 1); gl.drawArrays(gl.TRIANGLES, 0, n);
    bind(lines); gl.uniform1f(uniform("lit"), 0); gl.drawArrays(gl.LINES, 0, line.length / 3);
    gl.disable(gl.DEPTH_TEST); gl.drawArrays(gl.LINES, 0, line.length / 3);
    labels.forEach((e, i) => { const p = [0, 1, 2].map((c) => m.centre[c] + m.axes[i][c] - o[c]); e.style.left = (0.5 + 0.5 * (rows[0][0] * p[0] + rows[0][1] * p[1] + rows[0][2] * p[2])) * w + "px"; e.style.top = (0.5 - 0.5 * (rows[1][0] * p[0] + rows[1][1] * p[1] + rows[1][2] * p[2])) * h + "px"; });
  };
  const fingers = new Map(); let apart = 0;
  host.addEventListener("pointerdown", (e) => { fingers.set(e.pointerId, [e.clientX, e.clientY]); host.setPointerCapture(e.pointerId); });
  host.addEventListener("pointerup", (e) => { fingers.delete(e.pointerId); apart = 0; });
  host.addEventListener("pointercancel", (e) => { fingers.delete(e.pointerId); apart = 0; });
  host.addEventListener("pointermove", (e) => {
    const before = fingers.get(e.pointerId); if (!before) return;
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (fingers.size === 2) { const [a, b] = [...fingers.values()], d = Math.hypot(a[0] - b[0], a[1] - b[1]); if (apart) zoom *= d / apart; apart = d; }
    else { const y = (e.clientX - before[0]) * 0.008, x = (e.clientY - before[1]) * 0.008; R = mul([[1, 0, 0], [0, Math.cos(x), -Math.sin(x)], [0, Math.sin(x), Math.cos(x)]], mul([[Math.cos(y), 0, Math.sin(y)], [0, 1, 0], [-Math.sin(y), 0, Math.cos(y)]], R)); }
    draw();
  });
  host.addEventListener("wheel", (e) => { e.preventDefault(); zoom *= Math.exp(-e.deltaY * 0.001); zoom = Math.min(40, Math.max(0.2, zoom)); draw(); }, { passive: false });
  new ResizeObserver(draw).observe(host); draw();
})();
