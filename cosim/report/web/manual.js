// Search of the manual's headings: every word typed must stand in the heading or in its page's title.
const find = document.getElementById("find");
const found = document.getElementById("found");
find.addEventListener("input", () => {
  const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
  const hits = words.length ? HEADINGS.filter(([page, , text]) => words.every((word) => `${page} ${text}`.toLowerCase().includes(word))) : [];
  found.replaceChildren(...hits.slice(0, 12).map(([page, target, text]) => {
    const link = Object.assign(document.createElement("a"), { href: target, textContent: page === text ? text : `${text} (${page})` });
    const item = document.createElement("li");
    item.append(link);
    return item;
  }));
});
