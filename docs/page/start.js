// start.js - set the page up.

let choose = () => {};

async function begin() {
  const bytes = Uint8Array.from(atob(PAGE.wasm), (c) => c.charCodeAt(0));
  const lib = await Library.load(bytes);
  $("version").textContent = lib.version;
  $("built").textContent = PAGE.parquet
    ? "Reads CSV and Parquet."
    : "Reads CSV; built without npm, so without Parquet and vehicle files.";
  const log = new LogPane(lib, lib.desk(0));
  const drive = new DrivePane(lib, lib.desk(1), (rows, settings) => {
    choose("log");
    return log.adopt(rows, settings);
  });
  const tabs = ["log", "drive"];
  choose = (name, focus = false) => {
    for (const t of tabs) {
      $(`tab-${t}`).setAttribute("aria-selected", String(t === name));
      $(`tab-${t}`).tabIndex = t === name ? 0 : -1;
      $(`pane-${t}`).hidden = t !== name;
    }
    if (focus) $(`tab-${name}`).focus();
    if (name !== "drive" && drive.going) drive.toggle();
    if (name === "drive") drive.show();
    else log.chart.later();
  };
  for (const t of tabs) {
    $(`tab-${t}`).onclick = () => choose(t);
    $(`tab-${t}`).onkeydown = (e) => {
      if (e.key === "ArrowLeft" || e.key === "ArrowRight")
        choose(
          tabs.find((x) => x !== t),
          true,
        );
    };
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    log.chart.later();
    drive.show();
  });
  // paper is white: draw in the light colours
  for (const [event, on] of [
    ["beforeprint", true],
    ["afterprint", false],
  ]) {
    addEventListener(event, () => {
      document.documentElement.classList.toggle("print", on);
      log.chart.draw();
      drive.chart.draw();
      drive.look();
    });
  }
  window.tse = { lib, log, drive }; // for the console of the browser and for tests
}

begin().catch((error) => {
  $("fatal").textContent = `This browser cannot run the page: ${error.message}`;
  console.error(error);
});
