// What needs no server: the loupe over both pictures, the untouched picture while a key or button is held, copying,
// and the two pictures' sources, set once they have arrived, so that nothing flickers.
(() => {
  const here = new URL(location);
  here.searchParams.delete("token");  // a cookie stands for it by now
  history.replaceState(null, "", here);

  const ZOOM = 5;
  const all = selector => [...document.querySelectorAll(selector)];

  // The newest that was asked for stays, whichever arrives last.
  let asked = 0, passed = "";
  const put = async (selector, url, small) => {
    const image = document.querySelector(selector), number = ++asked, ahead = new Image();
    if (!image) return false;
    ahead.src = url;
    try {
      await ahead.decode();
    } catch {
      return false;
    }
    if (number < Number(image.dataset.number ?? 0)) return false;
    image.dataset.number = number;
    image.src = url;
    image.closest(".pane").classList.toggle("small", small);
    return true;
  };

  window.explorer = {
    async show(selector, url, small) {
      if (await put(selector, url, small)) document.documentElement.dataset.shown = url;
    },
    listen() {
      window.socket.on("preview", async (jpeg, painted) => {
        const url = URL.createObjectURL(new Blob([jpeg], {type: "image/jpeg"}));
        await put(".seen img.as-seen", url, false);
        requestAnimationFrame(() => {
          painted();
          URL.revokeObjectURL(passed);
          passed = url;
        });
      });
    },
    async copy(text) {
      document.documentElement.dataset.copied = text;
      try {
        await navigator.clipboard.writeText(text);
      } catch {
        const area = document.createElement("textarea");
        area.value = text;
        document.body.append(area);
        area.select();
        document.execCommand("copy");
        area.remove();
      }
    },
    async upload(url, input) {
      const [file] = input.files;
      input.value = "";
      if (!file) return;
      try {
        await fetch(`${url}?name=${encodeURIComponent(file.name)}`, {method: "POST", body: file});
      } catch {
        // the connection is closed on a file that is too large; the page says so
      }
    },
    turn() {
      emitEvent("turn", !document.body.classList.contains("body--dark"));
    },
    peek(on) {
      document.body.classList.toggle("peek", on);
    },
  };

  const look = event => {
    const held = event.target.closest?.(".held");
    document.body.classList.toggle("looking", Boolean(held));
    if (!held) return;
    const box = held.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width, y = (event.clientY - box.top) / box.height;
    for (const each of all(".held")) {
      const image = each.querySelector("img"), loupe = each.querySelector(".loupe");
      if (!image || !loupe || !each.clientWidth) continue;
      const zoom = Math.max(2, ZOOM * image.naturalWidth / each.clientWidth / (window.devicePixelRatio || 1));
      const wide = each.clientWidth * zoom, high = each.clientHeight * zoom;
      loupe.style.left = `${100 * x}%`;
      loupe.style.top = `${100 * y}%`;
      loupe.style.backgroundImage = `url("${image.currentSrc}")`;
      loupe.style.backgroundSize = `${wide}px ${high}px`;
      loupe.style.backgroundPosition = `${loupe.clientWidth / 2 - x * wide}px ${loupe.clientHeight / 2 - y * high}px`;
    }
  };
  addEventListener("pointermove", look);
  addEventListener("pointerdown", look);
  addEventListener("pointerup", event => event.pointerType !== "mouse" && document.body.classList.remove("looking"));
  document.addEventListener("pointerleave", () => document.body.classList.remove("looking"));

  const typing = event => event.target.closest?.("input, textarea, select, [contenteditable]");
  addEventListener("keydown", event => event.key === "o" && !typing(event) && !event.ctrlKey && !event.metaKey && explorer.peek(true));
  addEventListener("keyup", event => event.key === "o" && explorer.peek(false));
  addEventListener("blur", () => explorer.peek(false));
})();
