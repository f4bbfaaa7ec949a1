// Numbers from outside: nine readings that are typed or pasted, and tables of poses or of readings
// that are dropped or chosen, and played. It works on `page` of panel.js; Papa Parse reads the tables.

(() => {
  const $ = (id) => document.getElementById(id);
  const POSE = page.components.map(({key}) => key);
  const READINGS = ["a", "b", "c"].flatMap((k) => [`psi_${k}_mm`, `zeta_${k}_mm`, `power_${k}_mw`]);
  const TIMES = ["time_s", "host_s", "utc_s"], ROWS_PER_S = 25, MOST_MB = 64;
  const KEPT = "What was shown is kept.";

  // Reading -----------------------------------------------------------------------------------------

  function number(text) {
    const word = text.trim().toLowerCase();
    return word === "" || word === "nan" ? NaN : Number(word === "inf" || word.includes("0x") ? "-" : word);
  }

  // Which columns a table has of those that are shown, or an error that says what is missing.
  function columnsOf(names) {
    const place = (wanted) => wanted.map((name) => names.indexOf(name));
    const pose = place(POSE), readings = place(READINGS);
    const missing = (wanted, count) => wanted.slice(0, count).filter((name) => !names.includes(name));
    const without = [missing(POSE, 6), missing(READINGS, 9)];
    if (without[0].length && without[1].length) {
      const [closest, what] = without[0].length < 6 ? [without[0], "pose"] : [without[1], "reading"];
      throw new Error(`The table has neither all columns of a pose (${POSE.slice(0, 6).join(", ")}) nor all of ` +
        `the readings (${READINGS.join(", ")}). For a ${what} it lacks ${closest.join(", ")}; its first ` +
        `line has ${names.filter(Boolean).slice(0, 12).join(", ") || "no names"}. See that the first line names the columns.`);
    }
    const beam = place(["bx_mm", "by_mm"]);
    return {
      pose: without[0].length ? null : pose, readings: without[1].length ? null : readings,
      beam: without[0].length && !beam.includes(-1) ? beam : null,
      // beside its uncertainty it is an estimate, made of the readings themselves
      guessed: names.includes("u_bx_mm"),
      time: names.indexOf(TIMES.find((name) => names.includes(name))), status: names.indexOf("status"),
      motion: names.indexOf("motion"),
    };
  }

  // A table from its text. Throws an error that names the line.
  function parse(text) {
    const table = {count: 0, pose: [], readings: [], beam: [], time: [], status: [], motion: []};
    let names = null, columns = null;
    Papa.parse(text, {comments: "#", skipEmptyLines: "greedy", step({data, errors, meta}) {
      const line = () => text.slice(0, meta.cursor).replace(/\r?\n$/, "").split(/\r\n|\r|\n/).length;
      const fault = errors.find(({type}) => type === "Quotes");
      if (fault) throw new Error(`Line ${line()}: a quotation mark is not closed. Close it, or take it out.`);
      if (!names) {
        names = data.map((name) => name.trim());
        columns = columnsOf(names);
        return;
      }
      if (data.length !== names.length) {
        throw new Error(`Line ${line()} has ${data.length} values; the first line names ${names.length} columns. ` +
          "Each line needs one value for each column.");
      }
      const value = (n) => {
        const found = number(data[n]);
        if (Number.isFinite(found) || /^\s*(nan)?\s*$/i.test(data[n])) return found;
        throw new Error(`Line ${line()}, column ${names[n]}: “${data[n]}” is not a number. Write numbers with a ` +
          "point as the decimal mark; leave unknown ones empty.");
      };
      if (columns.pose) table.pose.push(columns.pose.map((n) => (n < 0 ? 0 : value(n))));
      if (columns.readings) table.readings.push(columns.readings.map(value));
      if (columns.beam) table.beam.push(columns.beam.map((n) => (columns.guessed ? NaN : value(n))));
      if (columns.time >= 0) table.time.push(value(columns.time));
      for (const name of ["status", "motion"]) if (columns[name] >= 0) table[name].push(data[columns[name]]);
      table.count++;
    }});
    if (!names) throw new Error("The file is empty. A table has a line of column names and a line for each pose or reading.");
    if (!table.count) throw new Error("The table has column names, but no rows.");
    return table;
  }

  async function textOf(file) {
    const head = new TextDecoder("latin1").decode(await file.slice(0, 4).arrayBuffer());
    if (head === "PAR1") throw new Error("This is Parquet; the page reads CSV. Let facets write the table with the ending .csv.");
    if (head.startsWith("PK")) throw new Error("This is a workbook or an archive; the page reads CSV. Save the table as CSV.");
    if (file.size > MOST_MB * 1e6) {
      throw new Error(`The file has ${Math.ceil(file.size / 1e6)} MB; the page reads ${MOST_MB} MB at most. Take a part of it.`);
    }
    try {
      return new TextDecoder("utf-8", {fatal: true}).decode(await file.arrayBuffer());
    } catch {
      throw new Error("This is not text in UTF-8, so not a table that the page can read. Save it as CSV in UTF-8.");
    }
  }

  async function take(files) {
    const [file, ...more] = files;
    if (!file) return;
    try {
      const text = await textOf(file), [, config = ""] = /^# config: (.*\S)/m.exec(text.slice(0, 2000)) || [];
      begin(file.name, parse(text));
      page.say("news", [
        more.length ? `One table is shown at a time: ${file.name}. The others were not read.` : "",
        config && config !== PAGE.name ? `${file.name} was made with the configuration ${config}; this page shows ${PAGE.name}.` : "",
      ].join(" ").trim());
    } catch (error) {
      page.say("news", `${file.name}: ${error.message} ${KEPT}`, true);
    }
  }

  // Playing -----------------------------------------------------------------------------------------

  let table = null, at = 0, playing = 0, own = false;

  function begin(name, found) {
    pause();
    const steps = found.time.slice(1, 2000).map((t, n) => t - found.time[n]).filter((step) => step > 0).sort((a, b) => a - b);
    const step = steps[steps.length >> 1];
    table = {...found, name, rate: step ? 1 / step : ROWS_PER_S};
    $("player").hidden = false;
    $("at").max = table.count - 1;
    show(0);
  }

  // The row as a pose and, where there are any, as readings; why: the reason where there is no pose.
  function rowAt(n) {
    const readings = table.readings[n] || null, status = table.status[n];
    if (!table.pose.length) {
      const found = solve(readings, table.beam[n]);
      return {readings, ...found, solved: true};
    }
    const pose = table.pose[n], known = pose.slice(0, 6).every(Number.isFinite);
    const state = pose.map((x, i) => (x || 0) * page.components[i].factor);
    return {readings, state: known ? state : null, why: known ? "" : status || "the table has none"};
  }

  function show(n) {
    at = Math.min(Math.max(n, 0), table.count - 1);
    const {state, readings, why, solved} = rowAt(at), kept = state || page.state();
    own = true;
    page.moveTo(kept, {
      measured: readings, posed: Boolean(state), source: readings ? "of the table" : "of the model at the table’s pose"});
    own = false;
    $("at").value = at;
    const time = table.time.length ? ` · ${Digits.seconds(Number.isFinite(table.time[at]) ? table.time[at] : null)}` : "";
    const motion = table.motion.length ? ` · ${table.motion[at]}` : "";
    $("at").setAttribute("aria-valuetext", `row ${at + 1} of ${table.count}${time}`);
    page.say("row", `${table.name}: row ${Digits.grouped(at + 1)} of ${Digits.grouped(table.count)}${time}${motion} · ` +
      (state ? solved ? `solved from its readings${why ? `: ${why}` : ""}` : "pose of the table"
        : `no pose: ${why}; the mirror is drawn where it was`), !state);
  }

  function play() {
    if (at === table.count - 1) at = 0;
    let before = performance.now(), place = at;
    const step = (now) => {
      place += (now - before) / 1000 * table.rate * Number($("speed").value);
      before = now;
      if (Math.floor(place) !== at) show(Math.floor(place));
      if (at === table.count - 1) pause();
      else playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
    $("run").textContent = "Pause";
  }

  function pause() {
    cancelAnimationFrame(playing);
    playing = 0;
    $("run").textContent = "Play";
  }

  function shut() {
    pause();
    table = null;
    $("player").hidden = true;
    page.moveTo(page.state());
  }

  // Own readings ------------------------------------------------------------------------------------

  // A pose from readings: the state, or why there is none; why is also said of a pose that is doubtful.
  // measured: where the beam was, mm, if that was measured: then `solve.beam_offset_um` comes to it.
  function solve(readings, measured = [0, 0]) {
    const knowledge = page.knowledge(), refusal = Model.refusal(knowledge);
    if (refusal) return {state: null, why: refusal};
    if (knowledge.beam === "known" && !measured.every(Number.isFinite)) {
      return {state: null, why: "the table does not say where the known beam was"};
    }
    const place = measured.map((x, n) => x + knowledge.place[n]);
    const found = Model.solve(readings, {...knowledge, place});
    if (found.status !== "converged") return {state: null, why: found.status, found};
    return {state: found.state, why: found.ok ? "" : "the readings fit no pose within their noise", found};
  }

  function accept(text) {
    const trimmed = text.trim();
    if (!trimmed) return page.say("own-said", "");
    if (/psi_|tx_/i.test(trimmed)) {
      try {
        begin("pasted table", parse(trimmed));
        return page.say("own-said", "The table is below the picture of the rig.");
      } catch (error) {
        return page.say("own-said", `${error.message} ${KEPT}`, true);
      }
    }
    const words = trimmed.split(/[\s,;]+/).filter(Boolean), values = words.map(number);
    const wrong = words.find((word, n) => !Number.isFinite(values[n]) && word.toLowerCase() !== "nan");
    if (wrong) return page.say("own-said", `“${wrong}” is not a number. ${KEPT}`, true);
    if (words.length !== 9) {
      return page.say("own-said", `${words.length} of 9 numbers, with a point as the decimal mark. ${KEPT}`, words.length > 9);
    }
    const {state, why, found} = solve(values);
    page.moveTo(state || page.state(), {measured: values, posed: Boolean(state), source: "your own"});
    if (!state) return page.say("own-said", `No pose: ${why}. The mirror is drawn where it was.`, true);
    const u = found.uncertainty, [mm, mrad] = [0, 3].map((n) => Math.max(...u.slice(n, n + 3)));
    return page.say("own-said", `Solved in ${found.steps} ${found.steps === 1 ? "step" : "steps"}${why ? `, but ${why}` : ""}. Standard uncertainties: ` +
      `${Digits.fine(mm, "mm")}, ${Digits.fine(1e3 * mrad, "mrad")} at most.`, Boolean(why));
  }

  // What is there ------------------------------------------------------------------------------------

  $("open").addEventListener("click", () => $("file").click());
  $("file").addEventListener("change", () => {
    take($("file").files);
    $("file").value = "";  // so that the same file can be chosen again
  });
  $("run").addEventListener("click", () => (playing ? pause() : play()));
  $("at").addEventListener("input", () => {
    pause();
    show(Number($("at").value));
  });
  $("shut").addEventListener("click", shut);
  $("own-text").addEventListener("input", () => accept($("own-text").value));
  $("own-now").addEventListener("click", () => {
    $("own-text").value = (page.measured() || page.readings()).map((value) => +value.toPrecision(12)).join(" ");
    accept($("own-text").value);
  });
  page.listen(() => { if (!own && playing) pause(); });
  addEventListener("dragover", (event) => {
    if (!event.dataTransfer.types.includes("Files")) return;
    event.preventDefault();
    $("drop").hidden = false;
  });
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) $("drop").hidden = true; });
  addEventListener("drop", (event) => {
    if (!event.dataTransfer.files.length) return;
    event.preventDefault();
    $("drop").hidden = true;
    take(event.dataTransfer.files);
  });
  page.take = take;
})();
