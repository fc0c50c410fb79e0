// Sphinx puts this behind its own search tools. `PAGES` is the text of every page, which
// site_reference.py writes when the site is built.
{
  const asked = new URLSearchParams(location.search).get("q") ?? "";
  const words = splitQuery(asked.toLowerCase()).filter((word) => !stopwords.has(word));
  const hits = (page) => {
    const text = (PAGES[page] ?? "").toLowerCase();
    const counts = words.map((word) => text.split(word).length - 1);
    return (1e4 * Math.min(...counts)) / (text.length + 1e4); // one word does not make a short page win
  };
  const BEHIND = /^(design\/|aircraft\/|CHANGELOG|CONTRIBUTING|README|SECURITY|docs\/(commands|formats|hangar|speed))/;

  Scorer.score = ([page, , , , score, , kind]) =>
    score * (kind === "title" ? 3 : 1) +
    (kind === "text" ? 5 * Math.log2(1 + hits(page)) : 0) -
    15 * BEHIND.test(page);

  // An entry of the index and a name in Python stand in front of what they are about.
  const whole = Search.htmlToText;
  Search.htmlToText = (html, anchor) => {
    const found = anchor && new DOMParser().parseFromString(html, "text/html").querySelector(`[id="${anchor.slice(1)}"]`);
    return found ? found.closest("section, dl").textContent : whole(html, "");
  };

  // A page opened as a file may not read other files.
  if (location.protocol === "file:") {
    const name = (url) => url.replace(/^\.\//, "").replace(/\.html$/, "");
    window.fetch = async (url) => ({ text: () => `<div role="main">${PAGES[name(url)]}</div>` });
  }
}
