"use strict";

/* The sections that hold all words, those whose heading does first. A section is {page, head, text}. */
function matches(sections, query) {
  const words = query.toLowerCase().split(/\s+/).filter((word) => word);
  if (!words.length) return [];
  const holds = (text) => words.every((word) => text.toLowerCase().includes(word));
  const found = sections.filter((section) => holds(`${section.page} ${section.head} ${section.text}`));
  const named = found.filter((section) => holds(section.head));
  return named.concat(found.filter((section) => !named.includes(section)));
}

/* What stands around the first of the words in a text. */
function excerpt(text, query) {
  const small = text.toLowerCase();
  const places = query.toLowerCase().split(/\s+/).filter((word) => word).map((word) => small.indexOf(word));
  const first = Math.min(...places.filter((place) => place >= 0));
  if (!Number.isFinite(first)) return text.slice(0, 140);
  const from = Math.max(0, first - 60);
  return (from ? "…" : "") + text.slice(from, first + 80) + (first + 80 < text.length ? "…" : "");
}

/* Every heading of the page with what stands below it up to the next. */
function sections(document) {
  const found = [];
  for (const article of document.querySelectorAll("article")) {
    let page = "";
    for (const node of article.children) {
      if (/^H[1-4]$/.test(node.tagName)) {
        page = page || node.textContent;
        found.push({ id: node.id, page, head: node.textContent, text: "" });
      } else if (found.length) {
        found[found.length - 1].text += ` ${node.textContent.replace(/\s+/g, " ")}`;
      }
    }
  }
  return found;
}

function main() {
  const all = sections(document);
  const field = document.getElementById("words");
  const output = document.getElementById("found");
  const show = () => {
    const query = field.value;
    const hits = matches(all, query);
    output.replaceChildren();
    if (!query.trim()) return;
    const said = document.createElement("p");
    said.textContent = hits.length ? `${hits.length} of ${all.length} sections` : "no section has all of these words";
    const list = document.createElement("ul");
    for (const hit of hits.slice(0, 40)) {
      const item = document.createElement("li");
      const link = document.createElement("a");
      link.setAttribute("href", `#${hit.id}`);
      link.textContent = hit.head === hit.page ? hit.page : `${hit.page}: ${hit.head}`;
      const words = document.createElement("span");
      words.textContent = ` ${excerpt(hit.text.trim(), query)}`;
      item.append(link, words);
      list.append(item);
    }
    output.append(said, list);
  };
  field.addEventListener("input", show);
  document.querySelector("form").addEventListener("submit", (event) => {
    event.preventDefault();
    const first = output.querySelector("a");
    if (first) location.hash = first.getAttribute("href");
  });
}

if (typeof document !== "undefined") main();
