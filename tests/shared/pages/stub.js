"use strict";
// As much of a browser's page as the scripts of reports and drawings use. What they use beyond it is an error.
const page = { ids: {}, listeners: [], clicks: [], frames: [], now: 0, active: null, errors: [] };

class Element {
  constructor(tag, attributes, parent) {
    Object.assign(this, { tagName: tag.toUpperCase(), attributes, parentElement: parent, children: [], listeners: {}, text: "" });
    this.style = {};
    this.dataset = {};
    for (const name in attributes) if (name.startsWith("data-")) this.dataset[name.slice(5)] = attributes[name];
    this.hidden = "hidden" in attributes;
    this.value = attributes.value || "";
    if (attributes.id) page.ids[attributes.id] = this;
    if (tag === "canvas") Object.assign(this, { width: 300, height: 150, clientWidth: 800 });
  }
  get id() { return this.attributes.id || ""; }
  get textContent() { return this.text + this.children.map(child => child.textContent).join(""); }
  set textContent(words) { this.text = words; this.children = []; }
  setAttribute(name, value) { this.attributes[name] = String(value); }
  getAttribute(name) { return name in this.attributes ? this.attributes[name] : null; }
  addEventListener(kind, done) { (this.listeners[kind] = this.listeners[kind] || []).push(done); }
  dispatchEvent(event) {
    event.target = event.target || this;
    (this.listeners[event.type] || []).forEach(done => done(event));
  }
  append(...more) { more.forEach(child => { child.parentElement = this; this.children.push(child); }); }
  replaceChildren(...more) { this.text = ""; this.children = []; this.append(...more); }
  click() {
    const event = happened("click");
    this.dispatchEvent(event);
    page.clicks.forEach(done => done(event));
  }
  closest(query) { return this.matches(query) ? this : this.parentElement && this.parentElement.closest(query); }
  scrollIntoView() { page.seen = this; }
  focus() { page.active = this; }
  setPointerCapture() {}
  all() { return this.children.flatMap(child => [child, ...child.all()]); }
  matches(query) {
    const [, tag, name, rest] = query.match(/^([a-z]*)(?:\.([\w-]+))?(?:\[(.+)\])?$/);
    const [key, wanted] = rest ? rest.split("=").map(part => part.replace(/"/g, "")) : [];
    return (!tag || this.tagName === tag.toUpperCase())
      && (!name || (this.attributes.class || "").split(" ").includes(name))
      && (!key || (key in this.attributes && (wanted === undefined || this.attributes[key] === wanted)));
  }
  querySelectorAll(query) { return this.all().filter(element => element.matches(query)); }
  querySelector(query) { return this.querySelectorAll(query)[0] || null; }
  getContext(kind) {
    if (this.tagName !== "CANVAS" || kind !== "2d") throw new Error("no such context");
    return this.pen = this.pen || new Pen();
  }
}

class Pen { // the pixels that were put, and the strokes on top of them
  constructor() { this.strokes = []; this.picture = null; }
  createImageData(width, height) { return { width, height, data: new Uint8ClampedArray(4 * width * height) }; }
  putImageData(picture) { this.picture = picture; this.strokes = []; }
  setLineDash(dash) { this.note("dash", ...dash); }
  beginPath() {}
  stroke() { this.note("stroke", this.lineWidth, this.strokeStyle); }
  fill() { this.note("fill", this.fillStyle); }
  moveTo(x, y) { this.note("from", x, y); }
  lineTo(x, y) { this.note("to", x, y); }
  arc(x, y, radius) { this.note("arc", x, y, radius); }
  fillText(words, x, y) { this.note("text", words, x, y); }
  strokeText(words, x, y) { this.note("halo", words, x, y); }
  measureText(words) { return { width: 7 * words.length }; }
  note(...words) {
    if (words.some(word => Number.isNaN(word) || word === undefined)) throw new Error("drawn without a number: " + words);
    this.strokes.push(words.join(" "));
  }
  digest() {
    let sum = 2166136261;
    for (const value of new Uint32Array(this.picture.data.buffer)) sum = Math.imul(sum ^ value, 16777619);
    for (const words of this.strokes) for (const letter of words) sum = Math.imul(sum ^ letter.charCodeAt(0), 16777619);
    return sum >>> 0;
  }
  colours() { return new Set(new Uint32Array(this.picture.data.buffer)).size; }
}

function happened(type, more) { return Object.assign({ type, preventDefault() { this.stopped = true; } }, more); }

function built(node, parent) {
  const [tag, attributes, children] = node, element = new Element(tag, attributes, parent);
  children.forEach(child => {
    if (typeof child === "string") element.text += child; else element.children.push(built(child, element));
  });
  if (tag === "select") {
    const chosen = element.children.find(option => "selected" in option.attributes) || element.children[0];
    element.value = chosen.attributes.value;
  }
  return element;
}

const document = { getElementById: id => page.ids[id] || null, querySelector: query => page.root.querySelector(query),
  querySelectorAll: query => page.root.querySelectorAll(query), createElement: tag => new Element(tag, {}, null),
  addEventListener(kind, done) { if (kind !== "click") throw new Error("no such event"); page.clicks.push(done); }, get activeElement() { return page.active; } };
const location = { hash: "" };
const window = { devicePixelRatio: 1, performance: { now: () => page.now }, addEventListener(kind, done) { page.listeners.push([kind, done]); },
  requestAnimationFrame(done) { page.frames.push(done); } };

function passed(milliseconds) { // a frame later
  page.now += milliseconds;
  page.frames.splice(0).forEach(done => done(page.now));
}

function pressed(key) {
  const event = happened("keydown", { key, ctrlKey: false, metaKey: false, altKey: false });
  page.active.dispatchEvent(event);
  return Boolean(event.stopped);
}
