// Sends dropped logs one after the other, and shows how far those are that are being read.
"use strict";
const drop = document.getElementById("drop");
const choose = document.getElementById("choose");
const sent = document.getElementById("sent");
const later = (ms) => new Promise((done) => setTimeout(done, ms));
let last = Promise.resolve();

function send(file, line) {
  return new Promise((done) => {
    const request = new XMLHttpRequest();
    request.open("PUT", "/flights/" + encodeURIComponent(file.name));
    request.upload.onprogress = (event) => {
      line.textContent = `${file.name}: ${Math.round(100 * event.loaded / (event.total || 1))} % sent`;
    };
    request.onloadend = () => done(request);
    request.send(file);
  });
}

async function take(file) {
  const line = sent.appendChild(document.createElement("li"));
  line.textContent = `${file.name}: waits`;
  last = last.then(async () => {
    let request = await send(file, line);
    while (request.status === 503) {
      line.textContent = `${file.name}: waits, ${request.responseText.trim()}`;
      await later(2000);
      request = await send(file, line);
    }
    if (request.status === 201) {
      line.remove();
      await look();
    } else {
      line.className = "failed";
      line.textContent = `${file.name}: ${request.responseText.trim() || "not sent"}`;
    }
  });
}

async function refresh() {
  const answer = await fetch("/");
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  const [now, then] = [document.querySelector("#flights tbody"), page.querySelector("#flights tbody")];
  if (!now || !then) {
    if (then) location.reload();
    return;
  }
  const typing = document.activeElement;
  if (!(typing && typing.name === "options")) now.replaceWith(document.adoptNode(then));
}

let shown = null;
async function look() {
  const states = await (await fetch("/progress")).json();
  const names = Object.keys(states).sort().join("\n");
  if (shown !== null && names !== shown) await refresh();
  shown = names;
  for (const cell of document.querySelectorAll(".state")) {
    if (cell.dataset.name in states) cell.textContent = states[cell.dataset.name];
  }
}

async function watch() {
  for (;;) {
    try { await look(); } catch { /* the server has ended, or starts again */ }
    await later(1000);
  }
}

drop.hidden = false;
choose.addEventListener("change", () => { [...choose.files].forEach(take); choose.value = ""; });
for (const kind of ["dragover", "drop"]) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    drop.classList.toggle("over", kind === "dragover");
    if (kind === "drop") [...event.dataTransfer.files].forEach(take);
  });
}
document.addEventListener("dragleave", () => drop.classList.remove("over"));
watch();
