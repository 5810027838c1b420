// The tables of a bundle: Parquet, neither compressed nor coded, as payscope writes it. What is
// written otherwise is refused. Source: Apache Parquet format, Encodings and parquet.thrift.

const MOST_ROWS = 100000;
const PARQUET_TYPES = { 0: "bool", 2: "int64", 5: "double", 6: "string" };

/** Thrift's compact protocol: a struct becomes an object by number of the field. */
class Thrift {
  constructor(bytes, at) {
    this.bytes = bytes;
    this.at = at;
  }

  byte() {
    if (this.at >= this.bytes.length) throw new Fault("ends in the middle");
    return this.bytes[(this.at += 1) - 1];
  }

  unsigned() {
    let value = 0, weight = 1;
    for (let count = 0; count < 8; count += 1, weight *= 128) {
      const byte = this.byte();
      value += (byte & 127) * weight;
      if (byte < 128) return value;
    }
    throw new Fault("has a number that is too long");
  }

  signed() {
    const value = this.unsigned();
    return value % 2 ? -(value + 1) / 2 : value / 2;
  }

  take(length) {
    if (this.at + length > this.bytes.length) throw new Fault("ends in the middle");
    return this.bytes.subarray(this.at, (this.at += length));
  }

  value(type, depth) {
    if (depth > 16) throw new Fault("is nested too deeply");
    if (type === 1 || type === 2) return type === 1;
    if (type === 3) return this.byte();
    if (type >= 4 && type <= 6) return this.signed();
    if (type === 7) return this.take(8);
    if (type === 8) return this.take(this.unsigned());
    if (type === 12) return this.struct(depth + 1);
    if (type !== 9 && type !== 10) throw new Fault("has a field of an unknown kind");
    const head = this.byte();
    const length = head >> 4 === 15 ? this.unsigned() : head >> 4;
    if (length > this.bytes.length) throw new Fault("ends in the middle");
    return Array.from({ length }, () => this.value(head & 15, depth + 1));
  }

  struct(depth = 0) {
    const found = {};
    let number = 0;
    for (let head = this.byte(); head !== 0; head = this.byte()) {
      number = head >> 4 ? number + (head >> 4) : this.signed();
      found[number] = this.value(head & 15, depth);
    }
    return found;
  }
}

/** Numbers of one bit in Parquet's hybrid of runs and packed bits. */
const hybridBits = (reader, count) => {
  const length = new DataView(reader.take(4).slice().buffer).getUint32(0, true);
  const inside = new Thrift(reader.take(length), 0);
  const bits = [];
  while (bits.length < count) {
    const head = inside.unsigned();
    if (head % 2 === 0) {
      const bit = inside.byte() & 1;
      for (let k = head / 2; k > 0 && bits.length < count; k -= 1) bits.push(bit);
    } else {
      for (const byte of inside.take((head - 1) / 2)) for (let k = 0; k < 8; k += 1) bits.push((byte >> k) & 1);
    }
  }
  return bits.slice(0, count);
};

const plainValues = (reader, type, count, encoding) => {
  if (type === "bool") {
    if (encoding === 3) return hybridBits(reader, count).map(Boolean);
    const bytes = reader.take(Math.ceil(count / 8));
    return Array.from({ length: count }, (_, k) => Boolean((bytes[k >> 3] >> (k & 7)) & 1));
  }
  return Array.from({ length: count }, () => {
    if (type === "string") {
      const length = new DataView(reader.take(4).slice().buffer).getUint32(0, true);
      return textOf(reader.take(length), "a text of it");
    }
    const view = new DataView(reader.take(8).slice().buffer);
    if (type === "double") {
      const value = view.getFloat64(0, true);
      if (!Number.isFinite(value)) throw new Fault("holds a number that is not finite");
      return value;
    }
    const value = Number(view.getBigInt64(0, true));
    if (!Number.isSafeInteger(value)) throw new Fault("holds a whole number that is too large");
    return value;
  });
};

const columnValues = (bytes, about, type, optional, rows) => {
  if (about[4] !== 0) throw new Fault("is compressed, which such a table never is");
  const values = [];
  const reader = new Thrift(bytes, about[9]);
  while (values.length < rows) {
    const head = reader.struct();
    const page = head[5];
    if (head[1] !== 0 || !page || !(page[1] > 0) || ![0, 3].includes(page[2])) {
      throw new Fault("is coded, which such a table never is");
    }
    const there = optional ? hybridBits(reader, page[1]) : new Array(page[1]).fill(1);
    const plain = plainValues(reader, type, there.reduce((sum, bit) => sum + bit, 0), page[2]);
    let next = 0;
    for (const bit of there) values.push(bit ? plain[(next += 1) - 1] : null);
  }
  if (values.length !== rows) throw new Fault("has columns of different lengths");
  return values;
};

/** The rows of a table, an object each, with exactly these columns: [[name, type], …]. */
const parquetRows = (bytes, columns) => {
  const end = bytes.length;
  const mark = (at) => String.fromCharCode(...bytes.subarray(at, at + 4));
  if (end < 12 || mark(0) !== "PAR1" || mark(end - 4) !== "PAR1") throw new Fault("is no Parquet file");
  const length = new DataView(bytes.slice(end - 8, end - 4).buffer).getUint32(0, true);
  if (length > end - 12) throw new Fault("ends in the middle");
  const file = new Thrift(bytes, end - 8 - length).struct();
  const [, ...fields] = file[2] ?? [];
  const named = fields.map((field) => [textOf(field[4], "a name of it"), PARQUET_TYPES[field[1]]]);
  if (JSON.stringify(named) !== JSON.stringify(columns)) throw new Fault("has other columns than such a table");
  if (!(file[3] >= 0 && file[3] <= MOST_ROWS)) throw new Fault(`has more than ${MOST_ROWS} rows`);
  const rows = [];
  for (const group of file[4] ?? []) {
    if (!(group[3] <= MOST_ROWS)) throw new Fault(`has more than ${MOST_ROWS} rows`);
    const parts = columns.map(([, type], k) =>
      columnValues(bytes, group[1][k][3], type, fields[k][3] === 1, group[3]));
    for (let row = 0; row < group[3]; row += 1) {
      rows.push(Object.fromEntries(columns.map(([name], k) => [name, parts[k][row]])));
    }
  }
  if (rows.length !== file[3]) throw new Fault("has another number of rows than it says");
  return rows;
};
