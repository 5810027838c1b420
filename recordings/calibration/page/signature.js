// The signature of a bundle: an in-toto statement about its files in a DSSE envelope, and whose it is.

const PAYLOAD_TYPE = "application/vnd.in-toto+json";
const STATEMENT_TYPE = "https://in-toto.io/Statement/v1";
const PREDICATE_TYPE = "https://payscope.invalid/calibration-evidence/v1";
/** What stands before the 32 bytes of an Ed25519 key in a public key's DER (RFC 8410). */
const KEY_HEAD = "302a300506032b6570032100";

/** The 32 bytes of a key as somebody pasted it: PEM, or base64 of the raw key; null for nothing. */
const keyOf = (text) => {
  const pasted = text.trim();
  if (!pasted) return null;
  if (/PRIVATE KEY/.test(pasted)) throw new Fault("that is a private key: keep it secret, and give the public one");
  const pem = /^-----BEGIN PUBLIC KEY-----([A-Za-z0-9+/=\s]+)-----END PUBLIC KEY-----$/.exec(pasted);
  const bytes = unbase64((pem ? pem[1] : pasted).replace(/\s+/g, ""), "the key");
  const der = bytes.length === 44 && hex(bytes.subarray(0, 12)) === KEY_HEAD;
  const key = der ? bytes.subarray(12) : bytes;
  if (key.length !== 32 || (pem && !der)) throw new Fault("that is no Ed25519 public key, in PEM or base64");
  const fault = weakness(key);
  if (fault) throw new Fault(`weak key: it ${fault}`);
  return key;
};

/** DSSE's pre-authentication encoding: what is signed. */
const signedBytes = (payload) =>
  joined(utf8(`DSSEv1 ${utf8(PAYLOAD_TYPE).length} ${PAYLOAD_TYPE} ${payload.length} `), payload);

const envelopeOf = (bytes) => {
  const held = parseCanonical(bytes, STATEMENT);
  const names = (value) => Object.keys(value ?? {}).sort().join();
  const [signature] = Array.isArray(held?.signatures) ? held.signatures : [];
  if (names(held) !== "payload,payloadType,signatures" || held.signatures.length !== 1 ||
      names(signature) !== "keyid,sig" || held.payloadType !== PAYLOAD_TYPE) {
    throw new Fault("is no DSSE envelope with one signature");
  }
  const payload = unbase64(held.payload, "its payload");
  return {
    payload,
    statement: parseCanonical(payload, "its statement"),
    signature: unbase64(signature.sig, "its signature"),
    keyId: signature.keyid,
  };
};

const predicateOf = (evidence) => ({
  id: evidence.id,
  kind: evidence.kind,
  machine: evidence.campaign.machine.id,
  made: evidence.made,
  counter: evidence.chain.counter,
  previous: evidence.chain.previous,
});

/** Who signed, and whether it is these files: `trusted` only with the key that the user gave. */
const checkSignature = async (held, digests, evidence, given, add) => {
  const claimed = evidence?.signer?.name ?? "";
  const itself = claimed ? `that calls itself “${claimed}”` : "that gives no name";
  if (!held.has(STATEMENT)) {
    if (evidence?.signer) add("incomplete", STATEMENT, "is missing, although evidence.json names a signer");
    else if (given) add("incomplete", STATEMENT, "is missing: the bundle is unsigned, but you gave a key");
    return { trusted: false, text: "UNSIGNED: nobody vouches for this; whoever held the folder could have changed every number and every digest in it" };
  }
  const broken = { trusted: false, text: "Signature not valid" };
  let signed, stated = null;
  try {
    signed = envelopeOf(held.get(STATEMENT));
    if (evidence?.signer) stated = unbase64(evidence.signer.public_key, "the signer's key");
  } catch (fault) {
    if (!(fault instanceof Fault)) throw fault;
    add("tampered", STATEMENT, fault.message);
    return broken;
  }
  let right = true;
  const wrong = (kind, item, what) => { right = false; add(kind, item, what); };
  const key = given ?? stated;
  const keyId = key ? hex(await sha256(key)) : "";
  if (!evidence?.signer) wrong("tampered", "evidence.json", "names no signer, and there is a signature");
  else if (weakness(stated)) wrong("tampered", "evidence.json", `signer: weak key: it ${weakness(stated)}`);
  else {
    const statedId = hex(await sha256(stated));
    if (statedId !== evidence.signer.key_id || statedId !== signed.keyId) {
      wrong("tampered", "evidence.json", "signer.key_id is not that of the signature's key");
    }
    if (given && !sameBytes(given, stated)) {
      wrong("tampered", STATEMENT, `is signed by ${statedId.slice(0, 12)}… and not by the key that you gave, ${keyId.slice(0, 12)}…`);
    }
  }
  let by = "";
  if (key) {
    const found = await verifySignature(key, signed.signature, signedBytes(signed.payload));
    by = found.by;
    if (!found.valid) wrong("tampered", STATEMENT, given ? "is not signed by the key that you gave" : "its signature is not by the key it names");
  }
  const said = signed.statement;
  if (said?._type !== STATEMENT_TYPE || said?.predicateType !== PREDICATE_TYPE) wrong("tampered", STATEMENT, "is a statement of another kind");
  const subjects = new Map((Array.isArray(said?.subject) ? said.subject : []).map((each) => [each?.name, canonicalText(each?.digest ?? null)]));
  const wanted = new Map([...digests].filter(([name]) => name === SUMS || !UNLISTED_FILES.includes(name)));
  for (const name of new Set([...subjects.keys(), ...wanted.keys()])) {
    if (!wanted.has(name)) wrong("incomplete", String(name), "is missing, although it was there when it was signed");
    else if (!subjects.has(name)) wrong("tampered", name, "was not there when the bundle was signed");
    else if (subjects.get(name) !== canonicalText({ sha256: wanted.get(name) })) wrong("tampered", name, "is not the file that was signed");
  }
  if (evidence && canonicalText(said?.predicate ?? null) !== canonicalText(predicateOf(evidence))) {
    wrong("tampered", STATEMENT, "is about other evidence than evidence.json");
  }
  if (!right) return broken;
  return given
    ? { trusted: true, keyId, by, text: `Signed by the key that you gave, ${itself}` }
    : { trusted: false, keyId, by, text: `Signed by an unknown key ${itself}: not trusted. Whoever made this folder may have made up the key and the name as well` };
};
