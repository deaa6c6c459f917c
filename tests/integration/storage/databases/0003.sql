BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0003');
CREATE TABLE api_key (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	name TEXT NOT NULL, 
	prefix VARCHAR(64) NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	scopes JSON NOT NULL, 
	created_at DATETIME NOT NULL, 
	last_used_at DATETIME, 
	revoked_at DATETIME, expires_at DATETIME, 
	CONSTRAINT pk_api_key PRIMARY KEY (id), 
	CONSTRAINT fk_api_key_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id), 
	CONSTRAINT uq_api_key_sha256 UNIQUE (sha256)
);
INSERT INTO "api_key" VALUES('key_01m8000z5knh782p113j7me5mn','ws_default','old key','st_the_key','0692e0d0071bdd7061c2f5f108f9a2d8da6406ffbef7df0cafc5b19910c0ac3e','["admin"]','2026-11-21 21:26:01.653916',NULL,NULL,NULL);
CREATE TABLE application_versions (
    version_id TEXT NOT NULL PRIMARY KEY,
    version_name TEXT NOT NULL UNIQUE,
    version_timestamp INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000),
    created_at INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000)
, "application_name" TEXT DEFAULT NULL);
CREATE TABLE audit_entry (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	principal VARCHAR(40) NOT NULL, 
	request_id VARCHAR(64), 
	action VARCHAR(64) NOT NULL, 
	target VARCHAR(64) NOT NULL, 
	detail JSON, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_audit_entry PRIMARY KEY (id), 
	CONSTRAINT fk_audit_entry_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
INSERT INTO "audit_entry" VALUES('aud_01m8000z638rkdqyqqb2wz6y6r','ws_default','installation',NULL,'key.create','key_01m8000z5knh782p113j7me5mn','{"name":"old key","scopes":["admin"]}','2026-11-21 21:26:01.667895');
INSERT INTO "audit_entry" VALUES('aud_01m8000z68v5spbq231jaaaq1d','ws_default','installation',NULL,'system.create','sys_01m8000z67xsxpsrk1qp15hwrh','{"revision":1}','2026-11-21 21:26:01.673133');
INSERT INTO "audit_entry" VALUES('aud_01m8000z6djhy7940mmpvng3mm','ws_default','installation',NULL,'system.update','sys_01m8000z67xsxpsrk1qp15hwrh','{"revision":2}','2026-11-21 21:26:01.677306');
INSERT INTO "audit_entry" VALUES('aud_01m8000z6e0fmdvxghtjq3gnq0','ws_default','installation',NULL,'dataset.create','ds_01m8000z6drbdxrmxpar6ma8bj',NULL,'2026-11-21 21:26:01.679070');
INSERT INTO "audit_entry" VALUES('aud_01m8000z6p3w1vnkq0m65rr94p','ws_default','installation',NULL,'dataset.commit','ds_01m8000z6drbdxrmxpar6ma8bj','{"sha256":"5bee9da9611be64244af3c633ba1a6f11fb338d711e6c610d75de66487ea3699"}','2026-11-21 21:26:01.686942');
INSERT INTO "audit_entry" VALUES('aud_01m8000z777a0qp4qn2bcj7vja','ws_default','installation',NULL,'job.create','job_01m8000z7318c6fra8mfcjnv2t','{"kind":"identification"}','2026-11-21 21:26:01.704065');
INSERT INTO "audit_entry" VALUES('aud_01m8000z7k7yx83x05dc58jzcp','ws_default','installation',NULL,'job.create','job_01m8000z7hpkcm7q1hvk4hzv7x','{"kind":"identification"}','2026-11-21 21:26:01.716383');
INSERT INTO "audit_entry" VALUES('aud_01m8000z7xm1dj6m50rv21defz','ws_default','installation',NULL,'result.create','res_01m8000z7vmjrhba13kw2hpet6','{"kind":"identification"}','2026-11-21 21:26:01.726074');
INSERT INTO "audit_entry" VALUES('aud_01m8000z85g0agypnea5h238nf','ws_default','installation',NULL,'schedule.create','sch_01m8000z840mrrqgfrx5qget88',NULL,'2026-11-21 21:26:01.733746');
CREATE TABLE blob (
	sha256 VARCHAR(64) NOT NULL, 
	size INTEGER NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_blob PRIMARY KEY (sha256)
);
INSERT INTO "blob" VALUES('5bee9da9611be64244af3c633ba1a6f11fb338d711e6c610d75de66487ea3699',320,'2026-11-21 21:26:01.681124');
INSERT INTO "blob" VALUES('92d0af4b59b06d68819459c1cd82c8346c3d22116451451d14d6885dc2f02aab',160,'2026-11-21 21:26:01.691049');
INSERT INTO "blob" VALUES('5bfef65a7c0b625229f7d28f1767e551ed3f4d8e47252a2e3cd726a7e9deca79',32,'2026-11-21 21:26:01.693353');
INSERT INTO "blob" VALUES('f8691cb65480e10e089a185279244e71fdedd245b5f882e0e03f399ed907e5bc',160,'2026-11-21 21:26:01.694463');
INSERT INTO "blob" VALUES('b44648ff88afffb62d89145333df9c40c17f44a3a8c0da33ce5381c51d189cb3',32,'2026-11-21 21:26:01.695453');
INSERT INTO "blob" VALUES('ff49ce5f3bee285fa16f76ccf048fcdcd203b0b7b9810eec1dc07f220df546e2',288,'2026-11-21 21:26:01.724339');
INSERT INTO "blob" VALUES('dff8584559d06116a3195f0316d13f4b88fb9f0c6a5ae5dfe74f3da05c213110',288,'2026-11-21 21:26:01.725498');
CREATE TABLE blob_chunk (
	sha256 VARCHAR(64) NOT NULL, 
	number INTEGER NOT NULL, 
	encoding VARCHAR(64) NOT NULL, 
	data BLOB NOT NULL, 
	CONSTRAINT pk_blob_chunk PRIMARY KEY (sha256, number), 
	CONSTRAINT fk_blob_chunk_sha256_blob FOREIGN KEY(sha256) REFERENCES blob (sha256) ON DELETE CASCADE
);
INSERT INTO "blob_chunk" VALUES('5bee9da9611be64244af3c633ba1a6f11fb338d711e6c610d75de66487ea3699',0,'zlib/1',X'78014DC7390E82501440D1575A5A50505818630C31C4088A030E7CFC1B63C92EC18253789B931BF1DF77706976C1250B965C71CD0DB7DCB1E29E350F3CB261CB13CFEC78E19537DED9F3C1275F7C73609A9D18A3677C3C23FB9C7E81AD13CC');
INSERT INTO "blob_chunk" VALUES('92d0af4b59b06d68819459c1cd82c8346c3d22116451451d14d6885dc2f02aab',0,'zlib/8',X'7801636018282020A1A0A2A16360646266616563E7E0E8E4CCE0800900920A083F');
INSERT INTO "blob_chunk" VALUES('5bfef65a7c0b625229f7d28f1767e551ed3f4d8e47252a2e3cd726a7e9deca79',0,'zlib/8',X'78016360C0011CEC9C191C1C1C0006230182');
INSERT INTO "blob_chunk" VALUES('f8691cb65480e10e089a185279244e71fdedd245b5f882e0e03f399ed907e5bc',0,'zlib/8',X'78016360A03F6800820F1C22324A6A5A7A86C6A6E696D6B6F60E8E4ECEF60E98000015E10B8E');
INSERT INTO "blob_chunk" VALUES('b44648ff88afffb62d89145333df9c40c17f44a3a8c0da33ce5381c51d189cb3',0,'zlib/8',X'78016360C0021A181A3E38D83BDB3B3838000018A503B2');
INSERT INTO "blob_chunk" VALUES('ff49ce5f3bee285fa16f76ccf048fcdcd203b0b7b9810eec1dc07f220df546e2',0,'zlib/8',X'78019B5C56A45E54949AAAA900010C7FFEFCFA53FDABF28F75F5AE5F96953BFECCB1BEEDC7A0AE93A8AEA3AE0353B37265DD4A91BA972BEF8B78D66D7929B7F2C8FD9FA1D5560A79560A5650250A0C1F3F667D5C97A5F6D17F1D4FD609B5D68F0AFE75BEEA0AEAF10AEA0AB530732E5DDA73C97D8FE1A55E77A63D6586AF2F6DE8CD0A48514FCB772BD6809BE3EB5BE2FBB084C377FA43ED927D1C81BE45D3F744A6DAE417256618C1D524254D4EAA9ABC2629AFAA7DF2FC353B9232F24A188BD38A5272120DE06A0212320A4A2A6A1A9A5ADA3ABA7AFA264C9C349921D9A224B5B800E62D2E067B4C000022F36908');
INSERT INTO "blob_chunk" VALUES('dff8584559d06116a3195f0316d13f4b88fb9f0c6a5ae5dfe74f3da05c213110',0,'zlib/8',X'78019B5C56A45E54949AAAA900010CC752DF7995B925BD8E36B9BE4EF7AAB1B0F181137E0CEA3A89EA3AEA3A30350DD37954A5B6D4E55F9DDE2CF77DE94CC10D8BF442ABAD14F2AC14ACA04A1418BA14389BC52F9E30D8266D7BA72FF98169CC063D5F7505F5780575855A98396C15FDCDA75E3164E47ED0BA3BCFF76BCCCCAE888014F5B47CB7620DB83987D687C8267E6BFD62D15EB6B3A6A0F1F4CC8FF691A936F94589194670351F4EBE95BA25A1EC2C90C265BEEBFB7AB68687AB188BD38A5272120DE06AAE3C7EF5FEFDDBE7770F9D78F0E2EDFB77AF1E5D5CC9906C51925A5C00F31617833D0CEC87017B003E8E6D6B');
CREATE TABLE channel_block (
	dataset_id VARCHAR(40) NOT NULL, 
	channel INTEGER NOT NULL, 
	level INTEGER NOT NULL, 
	number INTEGER NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_channel_block PRIMARY KEY (dataset_id, channel, level, number), 
	CONSTRAINT fk_channel_block_dataset_id_dataset FOREIGN KEY(dataset_id) REFERENCES dataset (id) ON DELETE CASCADE, 
	CONSTRAINT fk_channel_block_sha256_blob FOREIGN KEY(sha256) REFERENCES blob (sha256)
);
INSERT INTO "channel_block" VALUES('ds_01m8000z6drbdxrmxpar6ma8bj',0,0,0,'92d0af4b59b06d68819459c1cd82c8346c3d22116451451d14d6885dc2f02aab');
INSERT INTO "channel_block" VALUES('ds_01m8000z6drbdxrmxpar6ma8bj',0,1,0,'5bfef65a7c0b625229f7d28f1767e551ed3f4d8e47252a2e3cd726a7e9deca79');
INSERT INTO "channel_block" VALUES('ds_01m8000z6drbdxrmxpar6ma8bj',1,0,0,'f8691cb65480e10e089a185279244e71fdedd245b5f882e0e03f399ed907e5bc');
INSERT INTO "channel_block" VALUES('ds_01m8000z6drbdxrmxpar6ma8bj',1,1,0,'b44648ff88afffb62d89145333df9c40c17f44a3a8c0da33ce5381c51d189cb3');
CREATE TABLE dataset (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	name TEXT NOT NULL, 
	format VARCHAR(64) NOT NULL, 
	status VARCHAR(64) NOT NULL, 
	channels JSON NOT NULL, 
	sample_rate DOUBLE, 
	start_time DATETIME, 
	sample_count BIGINT, 
	description JSON, 
	origin JSON, 
	manifest JSON, 
	sha256 VARCHAR(64), 
	size BIGINT, 
	error JSON, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_dataset PRIMARY KEY (id), 
	CONSTRAINT ck_dataset_status CHECK (status IN ('open', 'parsing', 'ready', 'failed')), 
	CONSTRAINT fk_dataset_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
INSERT INTO "dataset" VALUES('ds_01m8000z6drbdxrmxpar6ma8bj','ws_default','run 1','raw','ready','[{"name":"u","unit":"V","scale":1,"offset":0},{"name":"y","unit":"m","scale":1,"offset":0}]',1000.0,'2026-01-02 00:00:00.000000',20,NULL,NULL,'["5bee9da9611be64244af3c633ba1a6f11fb338d711e6c610d75de66487ea3699"]','5bee9da9611be64244af3c633ba1a6f11fb338d711e6c610d75de66487ea3699',320,NULL,'2026-11-21 21:26:01.678631');
CREATE TABLE dataset_segment (
	dataset_id VARCHAR(40) NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	size INTEGER NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_dataset_segment PRIMARY KEY (dataset_id, sha256), 
	CONSTRAINT fk_dataset_segment_dataset_id_dataset FOREIGN KEY(dataset_id) REFERENCES dataset (id) ON DELETE CASCADE, 
	CONSTRAINT fk_dataset_segment_sha256_blob FOREIGN KEY(sha256) REFERENCES blob (sha256)
);
INSERT INTO "dataset_segment" VALUES('ds_01m8000z6drbdxrmxpar6ma8bj','5bee9da9611be64244af3c633ba1a6f11fb338d711e6c610d75de66487ea3699',320,'2026-11-21 21:26:01.682321');
CREATE TABLE dbos_migrations (version INTEGER NOT NULL PRIMARY KEY);
INSERT INTO "dbos_migrations" VALUES(125);
CREATE TABLE idempotency (
	principal VARCHAR(40) NOT NULL, 
	"key" TEXT NOT NULL, 
	endpoint TEXT NOT NULL, 
	body_sha256 VARCHAR(64) NOT NULL, 
	state VARCHAR(64) NOT NULL, 
	claim VARCHAR(40) NOT NULL, 
	status_code INTEGER, 
	headers JSON, 
	body BLOB, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_idempotency PRIMARY KEY (principal, "key"), 
	CONSTRAINT ck_idempotency_state CHECK (state IN ('running', 'done'))
);
CREATE TABLE job (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	kind VARCHAR(64) NOT NULL, 
	status VARCHAR(64) NOT NULL, 
	progress DOUBLE NOT NULL, 
	message TEXT NOT NULL, 
	body JSON NOT NULL, 
	result_id VARCHAR(40), 
	error JSON, 
	attempts INTEGER NOT NULL, 
	worker VARCHAR(64), 
	last_event INTEGER NOT NULL, 
	created_at DATETIME NOT NULL, 
	started_at DATETIME, 
	finished_at DATETIME, schedule_id VARCHAR(40), 
	CONSTRAINT pk_job PRIMARY KEY (id), 
	CONSTRAINT ck_job_status CHECK (status IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')), 
	CONSTRAINT fk_job_result_id_result FOREIGN KEY(result_id) REFERENCES result (id), 
	CONSTRAINT fk_job_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
INSERT INTO "job" VALUES('job_01m8000z7318c6fra8mfcjnv2t','ws_default','identification','succeeded',1.0,'','{"request":{"system":{"name":"lag","parameters":{"k":{"value":2}},"blocks":{"u":{"kind":"input"},"plant":{"kind":"transfer_function","numerator":["=k"],"denominator":[0.1,1]}},"connections":[{"from":"u","to":"plant"}],"outputs":{"y":"plant"}},"dataset":"ds_01m8000z6drbdxrmxpar6ma8bj"},"system_reference":{"id":"sys_01m8000z67xsxpsrk1qp15hwrh","revision":2},"warnings":[]}','res_01m8000z7vmjrhba13kw2hpet6',NULL,1,'old-0',3,'2026-11-21 21:26:01.700573','2026-11-21 21:26:01.721079','2026-11-21 21:26:01.728751',NULL);
INSERT INTO "job" VALUES('job_01m8000z7hpkcm7q1hvk4hzv7x','ws_default','identification','queued',0.0,'','{"request":{"system":{"name":"lag","parameters":{"k":{"value":2}},"blocks":{"u":{"kind":"input"},"plant":{"kind":"transfer_function","numerator":["=k"],"denominator":[0.1,1]}},"connections":[{"from":"u","to":"plant"}],"outputs":{"y":"plant"}},"dataset":"ds_01m8000z6drbdxrmxpar6ma8bj"},"system_reference":null,"warnings":[]}',NULL,NULL,0,NULL,1,'2026-11-21 21:26:01.714003',NULL,NULL,NULL);
CREATE TABLE job_event (
	job_id VARCHAR(40) NOT NULL, 
	id INTEGER NOT NULL, 
	type VARCHAR(64) NOT NULL, 
	payload JSON NOT NULL, 
	at DATETIME NOT NULL, 
	CONSTRAINT pk_job_event PRIMARY KEY (job_id, id), 
	CONSTRAINT fk_job_event_job_id_job FOREIGN KEY(job_id) REFERENCES job (id) ON DELETE CASCADE
);
INSERT INTO "job_event" VALUES('job_01m8000z7318c6fra8mfcjnv2t',1,'status','{"status":"queued"}','2026-11-21 21:26:01.703420');
INSERT INTO "job_event" VALUES('job_01m8000z7hpkcm7q1hvk4hzv7x',1,'status','{"status":"queued"}','2026-11-21 21:26:01.715721');
INSERT INTO "job_event" VALUES('job_01m8000z7318c6fra8mfcjnv2t',2,'status','{"status":"running","attempt":1}','2026-11-21 21:26:01.722503');
INSERT INTO "job_event" VALUES('job_01m8000z7318c6fra8mfcjnv2t',3,'status','{"status":"succeeded"}','2026-11-21 21:26:01.731350');
CREATE TABLE notifications (
    message_uuid TEXT NOT NULL DEFAULT (hex(randomblob(16))) PRIMARY KEY,
    destination_uuid TEXT NOT NULL,
    topic TEXT,
    message TEXT NOT NULL,
    created_at_epoch_ms INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000), "serialization" TEXT DEFAULT NULL, "consumed" BOOLEAN NOT NULL DEFAULT FALSE, consumed_by_function_id INTEGER,
    FOREIGN KEY (destination_uuid) REFERENCES workflow_status(workflow_uuid) 
        ON UPDATE CASCADE ON DELETE CASCADE
);
CREATE TABLE "operation_outputs" (
    workflow_uuid TEXT NOT NULL,
    function_id INTEGER NOT NULL,
    function_name TEXT NOT NULL DEFAULT '',
    output TEXT,
    error TEXT,
    child_workflow_id TEXT,
    started_at_epoch_ms INTEGER,
    completed_at_epoch_ms INTEGER,
    serialization TEXT,
    application_name TEXT DEFAULT NULL,
    retention_timestamp INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000),
    PRIMARY KEY (workflow_uuid, function_id)
);
CREATE TABLE queues (
    queue_id TEXT PRIMARY KEY DEFAULT (hex(randomblob(16))),
    name TEXT NOT NULL UNIQUE,
    concurrency INTEGER,
    worker_concurrency INTEGER,
    rate_limit_max INTEGER,
    rate_limit_period_sec REAL,
    priority_enabled BOOLEAN NOT NULL DEFAULT FALSE,
    partition_queue BOOLEAN NOT NULL DEFAULT FALSE,
    polling_interval_sec REAL NOT NULL DEFAULT 1.0,
    created_at INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000),
    updated_at INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000)
, "application_name" TEXT DEFAULT NULL, "partition_concurrency" INTEGER DEFAULT NULL, "partition_worker_concurrency" INTEGER DEFAULT NULL, "partition_rate_limit_max" INTEGER DEFAULT NULL, "partition_rate_limit_period_sec" REAL DEFAULT NULL);
CREATE TABLE result (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	kind VARCHAR(64) NOT NULL, 
	body JSON NOT NULL, 
	request JSON, 
	system_id VARCHAR(40), 
	system_revision INTEGER, 
	versions JSON NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_result PRIMARY KEY (id), 
	CONSTRAINT fk_result_system_id_system FOREIGN KEY(system_id) REFERENCES system (id), 
	CONSTRAINT fk_result_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
INSERT INTO "result" VALUES('res_01m8000z7vmjrhba13kw2hpet6','ws_default','identification','{"parameters":{"k":3.0},"time":{"$array":0},"y":{"$array":1}}','{"request":{"system":{"name":"lag","parameters":{"k":{"value":2}},"blocks":{"u":{"kind":"input"},"plant":{"kind":"transfer_function","numerator":["=k"],"denominator":[0.1,1]}},"connections":[{"from":"u","to":"plant"}],"outputs":{"y":"plant"}},"dataset":"ds_01m8000z6drbdxrmxpar6ma8bj"},"system_reference":{"id":"sys_01m8000z67xsxpsrk1qp15hwrh","revision":2},"warnings":[]}','sys_01m8000z67xsxpsrk1qp15hwrh',2,'{"servotune":"0.1.0"}','2026-11-21 21:26:01.723789');
CREATE TABLE result_array (
	result_id VARCHAR(40) NOT NULL, 
	position INTEGER NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	CONSTRAINT pk_result_array PRIMARY KEY (result_id, position), 
	CONSTRAINT fk_result_array_result_id_result FOREIGN KEY(result_id) REFERENCES result (id) ON DELETE CASCADE, 
	CONSTRAINT fk_result_array_sha256_blob FOREIGN KEY(sha256) REFERENCES blob (sha256)
);
INSERT INTO "result_array" VALUES('res_01m8000z7vmjrhba13kw2hpet6',0,'ff49ce5f3bee285fa16f76ccf048fcdcd203b0b7b9810eec1dc07f220df546e2');
INSERT INTO "result_array" VALUES('res_01m8000z7vmjrhba13kw2hpet6',1,'dff8584559d06116a3195f0316d13f4b88fb9f0c6a5ae5dfe74f3da05c213110');
CREATE TABLE schedule (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	name TEXT NOT NULL, 
	cron TEXT NOT NULL, 
	time_zone TEXT NOT NULL, 
	kind VARCHAR(64) NOT NULL, 
	body JSON NOT NULL, 
	overlap VARCHAR(64) NOT NULL, 
	missed VARCHAR(64) NOT NULL, 
	paused BOOLEAN NOT NULL, 
	revision INTEGER NOT NULL, 
	next_at DATETIME, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_schedule PRIMARY KEY (id), 
	CONSTRAINT ck_schedule_overlap CHECK (overlap IN ('skip', 'queue', 'cancel_previous')), 
	CONSTRAINT ck_schedule_missed CHECK (missed IN ('none', 'one', 'all')), 
	CONSTRAINT fk_schedule_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
INSERT INTO "schedule" VALUES('sch_01m8000z840mrrqgfrx5qget88','ws_default','every night','30 2 * * *','Europe/Bucharest','identification','{"system":"sys_01m8000z67xsxpsrk1qp15hwrh","dataset":"ds_01m8000z6drbdxrmxpar6ma8bj","inputs":{"u":"u"},"outputs":{"y":"y"},"parameters":["k"]}','skip','one',1,1,NULL,'2026-11-21 21:26:01.733285');
CREATE TABLE schedule_run (
	id VARCHAR(40) NOT NULL, 
	schedule_id VARCHAR(40) NOT NULL, 
	due_at DATETIME NOT NULL, 
	outcome VARCHAR(64) NOT NULL, 
	job_id VARCHAR(40), 
	detail TEXT, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_schedule_run PRIMARY KEY (id), 
	CONSTRAINT ck_schedule_run_outcome CHECK (outcome IN ('started', 'waiting', 'skipped', 'missed', 'refused')), 
	CONSTRAINT fk_schedule_run_job_id_job FOREIGN KEY(job_id) REFERENCES job (id) ON DELETE SET NULL, 
	CONSTRAINT fk_schedule_run_schedule_id_schedule FOREIGN KEY(schedule_id) REFERENCES schedule (id) ON DELETE CASCADE
);
INSERT INTO "schedule_run" VALUES('run_01m8000z85hzbs1jm01bbkc278','sch_01m8000z840mrrqgfrx5qget88','2026-01-03 00:30:00.000000','skipped',NULL,'busy','2026-11-21 21:26:01.734261');
CREATE TABLE sign_in (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	name TEXT NOT NULL, 
	key_id VARCHAR(40), 
	scopes JSON, 
	created_at DATETIME NOT NULL, 
	expires_at DATETIME NOT NULL, 
	CONSTRAINT pk_sign_in PRIMARY KEY (id), 
	CONSTRAINT fk_sign_in_key_id_api_key FOREIGN KEY(key_id) REFERENCES api_key (id), 
	CONSTRAINT fk_sign_in_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id), 
	CONSTRAINT uq_sign_in_sha256 UNIQUE (sha256)
);
CREATE TABLE streams (
    workflow_uuid TEXT NOT NULL,
    key TEXT NOT NULL,
    value TEXT NOT NULL,
    "offset" INTEGER NOT NULL, function_id INTEGER NOT NULL DEFAULT 0, "serialization" TEXT DEFAULT NULL,
    PRIMARY KEY (workflow_uuid, key, "offset"),
    FOREIGN KEY (workflow_uuid) REFERENCES workflow_status(workflow_uuid) 
        ON UPDATE CASCADE ON DELETE CASCADE
);
CREATE TABLE system (
	id VARCHAR(40) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	name TEXT NOT NULL, 
	revision INTEGER NOT NULL, 
	created_at DATETIME NOT NULL, 
	updated_at DATETIME NOT NULL, 
	deleted_at DATETIME, 
	CONSTRAINT pk_system PRIMARY KEY (id), 
	CONSTRAINT fk_system_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
INSERT INTO "system" VALUES('sys_01m8000z67xsxpsrk1qp15hwrh','ws_default','lag',2,'2026-11-21 21:26:01.672025','2026-11-21 21:26:01.673787',NULL);
CREATE TABLE system_revision (
	system_id VARCHAR(40) NOT NULL, 
	number INTEGER NOT NULL, 
	document JSON NOT NULL, 
	schema_version INTEGER NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_system_revision PRIMARY KEY (system_id, number), 
	CONSTRAINT fk_system_revision_system_id_system FOREIGN KEY(system_id) REFERENCES system (id)
);
INSERT INTO "system_revision" VALUES('sys_01m8000z67xsxpsrk1qp15hwrh',1,'{"name":"lag","parameters":{"k":{"value":2}},"blocks":{"u":{"kind":"input"},"plant":{"kind":"transfer_function","numerator":["=k"],"denominator":[0.1,1]}},"connections":[{"from":"u","to":"plant"}],"outputs":{"y":"plant"}}',1,'2026-11-21 21:26:01.672692');
INSERT INTO "system_revision" VALUES('sys_01m8000z67xsxpsrk1qp15hwrh',2,'{"name":"lag","parameters":{"k":{"value":3}},"blocks":{"u":{"kind":"input"},"plant":{"kind":"transfer_function","numerator":["=k"],"denominator":[0.1,1]}},"connections":[{"from":"u","to":"plant"}],"outputs":{"y":"plant"}}',1,'2026-11-21 21:26:01.677042');
CREATE TABLE ticket (
	sha256 VARCHAR(64) NOT NULL, 
	workspace_id VARCHAR(40) NOT NULL, 
	principal VARCHAR(40) NOT NULL, 
	scopes JSON NOT NULL, 
	expires_at DATETIME NOT NULL, 
	CONSTRAINT pk_ticket PRIMARY KEY (sha256), 
	CONSTRAINT fk_ticket_workspace_id_workspace FOREIGN KEY(workspace_id) REFERENCES workspace (id)
);
CREATE TABLE worker (
	id VARCHAR(64) NOT NULL, 
	token VARCHAR(64) NOT NULL, 
	host TEXT NOT NULL, 
	pid INTEGER NOT NULL, 
	slots INTEGER NOT NULL, 
	started_at DATETIME NOT NULL, 
	seen_at DATETIME NOT NULL, 
	CONSTRAINT pk_worker PRIMARY KEY (id)
);
CREATE TABLE workflow_events (
    workflow_uuid TEXT NOT NULL,
    key TEXT NOT NULL,
    value TEXT NOT NULL, "serialization" TEXT DEFAULT NULL,
    PRIMARY KEY (workflow_uuid, key),
    FOREIGN KEY (workflow_uuid) REFERENCES workflow_status(workflow_uuid) 
        ON UPDATE CASCADE ON DELETE CASCADE
);
CREATE TABLE workflow_events_history (
    workflow_uuid TEXT NOT NULL,
    function_id INTEGER NOT NULL,
    key TEXT NOT NULL,
    value TEXT NOT NULL, "serialization" TEXT DEFAULT NULL,
    PRIMARY KEY (workflow_uuid, function_id, key),
    FOREIGN KEY (workflow_uuid) REFERENCES workflow_status(workflow_uuid)
        ON UPDATE CASCADE ON DELETE CASCADE
);
CREATE TABLE workflow_input (
    workflow_uuid TEXT NOT NULL PRIMARY KEY,
    inputs TEXT,
    retention_timestamp INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000)
);
INSERT INTO "workflow_input" VALUES('job_01m8000z7318c6fra8mfcjnv2t','{"namedArgs":{},"positionalArgs":["job_01m8000z7318c6fra8mfcjnv2t"]}',1795296361000);
INSERT INTO "workflow_input" VALUES('job_01m8000z7hpkcm7q1hvk4hzv7x','{"namedArgs":{},"positionalArgs":["job_01m8000z7hpkcm7q1hvk4hzv7x"]}',1795296361000);
CREATE TABLE workflow_output (
    workflow_uuid TEXT NOT NULL PRIMARY KEY,
    output TEXT,
    error TEXT,
    retention_timestamp INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000)
);
CREATE TABLE workflow_schedules (
    schedule_id TEXT PRIMARY KEY,
    schedule_name TEXT NOT NULL UNIQUE,
    workflow_name TEXT NOT NULL,
    workflow_class_name TEXT,
    schedule TEXT NOT NULL,
    status TEXT NOT NULL DEFAULT 'ACTIVE',
    context TEXT NOT NULL
, "last_fired_at" TEXT DEFAULT NULL, "automatic_backfill" BOOLEAN NOT NULL DEFAULT FALSE, "cron_timezone" TEXT DEFAULT NULL, "queue_name" TEXT DEFAULT NULL, "application_name" TEXT DEFAULT NULL);
CREATE TABLE workflow_status (
    workflow_uuid TEXT PRIMARY KEY,
    status TEXT,
    name TEXT,
    authenticated_user TEXT,
    assumed_role TEXT,
    authenticated_roles TEXT,
    request TEXT,
    output TEXT,
    error TEXT,
    executor_id TEXT,
    created_at INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000),
    updated_at INTEGER NOT NULL DEFAULT (strftime('%s','now') * 1000),
    application_version TEXT,
    application_id TEXT,
    class_name TEXT DEFAULT NULL,
    config_name TEXT DEFAULT NULL,
    recovery_attempts INTEGER DEFAULT 0,
    queue_name TEXT,
    workflow_timeout_ms INTEGER,
    workflow_deadline_epoch_ms INTEGER,
    inputs TEXT,
    started_at_epoch_ms INTEGER,
    deduplication_id TEXT,
    priority INTEGER NOT NULL DEFAULT 0
, queue_partition_key TEXT, forked_from TEXT, "owner_xid" TEXT DEFAULT NULL, "parent_workflow_id" TEXT DEFAULT NULL, "serialization" TEXT DEFAULT NULL, "delay_until_epoch_ms" BIGINT DEFAULT NULL, "was_forked_from" BOOLEAN NOT NULL DEFAULT FALSE, "rate_limited" BOOLEAN NOT NULL DEFAULT FALSE, "completed_at" BIGINT, "attributes" TEXT, "schedule_name" TEXT, "debounce_deadline_epoch_ms" BIGINT DEFAULT NULL, "is_debounced" BOOLEAN NOT NULL DEFAULT FALSE, "application_name" TEXT DEFAULT NULL, "creator_xid" TEXT DEFAULT NULL);
INSERT INTO "workflow_status" VALUES('job_01m8000z7318c6fra8mfcjnv2t','ENQUEUED','run_job',NULL,NULL,NULL,NULL,NULL,NULL,NULL,1795296361000,1795296361000,NULL,NULL,NULL,NULL,0,'jobs',NULL,NULL,NULL,NULL,NULL,0,NULL,NULL,NULL,NULL,'portable_json',NULL,0,0,NULL,'null',NULL,NULL,0,'servotune','a1e0cee7-fd70-46ca-ab34-53a233c6afcd');
INSERT INTO "workflow_status" VALUES('job_01m8000z7hpkcm7q1hvk4hzv7x','ENQUEUED','run_job',NULL,NULL,NULL,NULL,NULL,NULL,NULL,1795296361000,1795296361000,NULL,NULL,NULL,NULL,0,'jobs',NULL,NULL,NULL,NULL,NULL,0,NULL,NULL,NULL,NULL,'portable_json',NULL,0,0,NULL,'null',NULL,NULL,0,'servotune','bb8f0e25-1d24-42d5-a042-6c258a16af5e');
CREATE TABLE workspace (
	id VARCHAR(40) NOT NULL, 
	name TEXT NOT NULL, 
	created_at DATETIME NOT NULL, revision INTEGER DEFAULT '1' NOT NULL, limits JSON, stored_bytes BIGINT DEFAULT '0' NOT NULL, 
	CONSTRAINT pk_workspace PRIMARY KEY (id), 
	CONSTRAINT uq_workspace_name UNIQUE (name)
);
INSERT INTO "workspace" VALUES('ws_default','default','2026-11-21 21:26:01.568871',1,NULL,1457);
CREATE INDEX ix_idempotency_created_at ON idempotency (created_at);
CREATE INDEX ix_worker_seen_at ON worker (seen_at);
CREATE INDEX ix_api_key_workspace_id ON api_key (workspace_id);
CREATE INDEX ix_dataset_workspace_id_created_at_id ON dataset (workspace_id, created_at, id);
CREATE INDEX ix_system_workspace_id_created_at_id ON system (workspace_id, created_at, id);
CREATE INDEX ix_channel_block_sha256 ON channel_block (sha256);
CREATE INDEX ix_dataset_segment_sha256 ON dataset_segment (sha256);
CREATE INDEX ix_result_system_id ON result (system_id);
CREATE INDEX ix_result_workspace_id_created_at_id ON result (workspace_id, created_at, id);
CREATE INDEX ix_job_result_id ON job (result_id);
CREATE INDEX ix_job_status ON job (status);
CREATE INDEX ix_job_workspace_id_created_at_id ON job (workspace_id, created_at, id);
CREATE INDEX ix_result_array_sha256 ON result_array (sha256);
CREATE INDEX ix_sign_in_expires_at ON sign_in (expires_at);
CREATE INDEX ix_sign_in_key_id ON sign_in (key_id);
CREATE INDEX ix_sign_in_workspace_id ON sign_in (workspace_id);
CREATE INDEX ix_ticket_expires_at ON ticket (expires_at);
CREATE INDEX ix_ticket_workspace_id ON ticket (workspace_id);
CREATE INDEX ix_audit_entry_created_at ON audit_entry (created_at);
CREATE INDEX ix_audit_entry_workspace_id_created_at_id ON audit_entry (workspace_id, created_at, id);
CREATE INDEX ix_job_schedule_id ON job (schedule_id);
CREATE INDEX ix_schedule_next_at ON schedule (next_at);
CREATE INDEX ix_schedule_workspace_id_created_at_id ON schedule (workspace_id, created_at, id);
CREATE INDEX ix_schedule_run_job_id ON schedule_run (job_id);
CREATE INDEX ix_schedule_run_outcome ON schedule_run (outcome);
CREATE INDEX ix_schedule_run_schedule_id_created_at_id ON schedule_run (schedule_id, created_at, id);
CREATE INDEX workflow_status_created_at_index ON workflow_status (created_at);
CREATE INDEX idx_workflow_topic ON notifications (destination_uuid, topic);
CREATE INDEX "idx_workflow_status_delayed" ON "workflow_status" ("delay_until_epoch_ms") WHERE status = 'DELAYED';
CREATE INDEX "idx_workflow_status_forked_from" ON "workflow_status" ("forked_from") WHERE "forked_from" IS NOT NULL;
CREATE INDEX "idx_workflow_status_parent_workflow_id" ON "workflow_status" ("parent_workflow_id") WHERE "parent_workflow_id" IS NOT NULL;
CREATE UNIQUE INDEX "uq_workflow_status_dedup_id" ON "workflow_status" ("queue_name", "deduplication_id") WHERE "deduplication_id" IS NOT NULL;
CREATE INDEX "idx_workflow_status_pending" ON "workflow_status" ("created_at") WHERE "status" = 'PENDING';
CREATE INDEX "idx_workflow_status_failed" ON "workflow_status" ("status", "created_at") WHERE "status" IN ('ERROR', 'CANCELLED', 'MAX_RECOVERY_ATTEMPTS_EXCEEDED');
CREATE INDEX "idx_workflow_status_rate_limited" ON "workflow_status" ("queue_name", "started_at_epoch_ms") WHERE "rate_limited" = TRUE;
CREATE INDEX "idx_workflow_status_completed_at" ON "workflow_status" ("completed_at") WHERE "completed_at" IS NOT NULL;
CREATE INDEX "idx_workflow_status_started_at" ON "workflow_status" ("started_at_epoch_ms") WHERE "started_at_epoch_ms" IS NOT NULL;
CREATE INDEX "idx_workflow_status_schedule_name" ON "workflow_status" ("schedule_name") WHERE "schedule_name" IS NOT NULL;
CREATE UNIQUE INDEX "uq_application_versions_owner_version"
    ON application_versions ("application_name", "version_name")
    WHERE "application_name" IS NOT NULL;
CREATE UNIQUE INDEX "uq_application_versions_unclaimed_version"
    ON application_versions ("version_name")
    WHERE "application_name" IS NULL;
CREATE INDEX idx_workflow_input_retention
    ON workflow_input (retention_timestamp);
CREATE INDEX idx_workflow_output_retention
    ON workflow_output (retention_timestamp);
CREATE INDEX idx_operation_outputs_retention
    ON operation_outputs (retention_timestamp);
CREATE INDEX "idx_workflow_status_in_flight_v2" ON "workflow_status" ("queue_name", "status", "priority", "created_at", "application_name") WHERE "status" IN ('ENQUEUED', 'PENDING');
CREATE INDEX "idx_workflow_status_partition_dequeue_v3" ON "workflow_status" ("queue_name", "status", "queue_partition_key", "priority", "created_at", "workflow_uuid", "application_name") WHERE "status" IN ('ENQUEUED', 'PENDING') AND "queue_partition_key" IS NOT NULL;
CREATE INDEX "idx_operation_outputs_completed_at_function_name_v2" ON "operation_outputs" ("completed_at_epoch_ms", "function_name", "application_name");
CREATE INDEX "idx_workflow_status_deadline" ON "workflow_status" ("workflow_deadline_epoch_ms") WHERE "status" IN ('ENQUEUED', 'PENDING', 'DELAYED') AND "workflow_deadline_epoch_ms" IS NOT NULL;
CREATE INDEX "idx_application_versions_timestamp" ON "application_versions" ("version_timestamp" DESC);
CREATE INDEX "idx_application_versions_owner_timestamp" ON "application_versions" ("application_name", "version_timestamp" DESC);
COMMIT;
