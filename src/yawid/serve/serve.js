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
      throw new Error(request.responseText.trim() || "not sent");
    }
  }).catch((error) => {  // the next one is sent all the same
    line.className = "failed";
    line.textContent = `${file.name}: ${error.message}`;
  });
}

async function look() {
  const { version, logs } = await (await fetch("/progress")).json();
  const list = document.getElementById("list");
  const isTyped = list.contains(document.activeElement) && document.activeElement.name === "options";
  if (list.dataset.version !== String(version) && !isTyped) {
    const text = await (await fetch("/")).text();
    const page = new DOMParser().parseFromString(text, "text/html");
    list.replaceWith(document.adoptNode(page.getElementById("list")));
  }
  for (const cell of document.querySelectorAll(".state")) {
    cell.textContent = logs[cell.dataset.name] || cell.textContent;
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
