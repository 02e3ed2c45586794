//! Users with read access.

use std::time::Duration;

use opcua::crypto::SecurityPolicy;
use opcua::server::ServerEndpoint;
use opcua::server::authenticator::{AuthManager, Password, UserToken, user_pass_security_policy_id};
use opcua::types::{Error, StatusCode, UAString, UserTokenPolicy, UserTokenType};
use sha2::{Digest, Sha256};
use tracing::warn;

use equipoise_core::message::Printable;
use equipoise_files::secret::Login;

/// Longest user name in the log when access is refused.
const NAME_CHARS_MAX: usize = 64;
/// Delay after a wrong password, against guessing.
const AFTER_A_WRONG_PASSWORD: Duration = Duration::from_secs(1);

/// Users with read access to all nodes; no user has write access.
#[derive(Debug)]
pub struct Users {
    logins: Vec<Login>,
    anonymous: bool,
}

impl Users {
    /// Users of a file; `anonymous`: whether clients without a user name may read.
    pub fn new(logins: Vec<Login>, anonymous: bool) -> Users {
        Users { logins, anonymous }
    }

    fn knows(&self, name: &str, password: &str) -> bool {
        let mut found = false;
        // Every login is checked and digests are compared, so that the time taken reveals neither names nor passwords.
        for login in &self.logins {
            let same = Sha256::digest(login.password.as_bytes()) == Sha256::digest(password.as_bytes());
            found |= same & (login.name == name);
        }
        found
    }
}

#[async_trait::async_trait]
impl AuthManager for Users {
    async fn authenticate_anonymous_token(&self, _: &ServerEndpoint) -> Result<(), Error> {
        if self.anonymous {
            return Ok(());
        }
        Err(Error::new(StatusCode::BadIdentityTokenRejected, "a user must be named"))
    }

    async fn authenticate_username_identity_token(
        &self,
        _: &ServerEndpoint,
        name: &str,
        password: &Password,
    ) -> Result<UserToken, Error> {
        if self.knows(name, password.get()) {
            return Ok(UserToken(name.to_owned()));
        }
        let name = Printable { text: name, chars_max: NAME_CHARS_MAX };
        warn!("refused a client with the user name {name}");
        tokio::time::sleep(AFTER_A_WRONG_PASSWORD).await;
        Err(Error::new(StatusCode::BadUserAccessDenied, "unknown user or wrong password"))
    }

    fn user_token_policies(&self, endpoint: &ServerEndpoint) -> Vec<UserTokenPolicy> {
        let policy = |policy_id, token_type| UserTokenPolicy {
            policy_id,
            token_type,
            issued_token_type: UAString::null(),
            issuer_endpoint_url: UAString::null(),
            // Null: same as the endpoint's policy.
            security_policy_uri: UAString::null(),
        };
        let anonymous = self.anonymous.then(|| policy(UAString::from("anonymous"), UserTokenType::Anonymous));
        let named = !self.logins.is_empty() && endpoint.security_policy() != SecurityPolicy::Unknown;
        let named = named.then(|| policy(user_pass_security_policy_id(endpoint), UserTokenType::UserName));
        anonymous.into_iter().chain(named).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_and_password_belong_together() {
        let login =
            |name: &str, password: &str| Login { name: name.to_owned(), password: password.to_owned() };
        let users = Users::new(vec![login("plc", "one"), login("mes", "two")], false);
        assert!(users.knows("plc", "one") && users.knows("mes", "two"));
        for (name, password) in
            [("plc", "two"), ("mes", "one"), ("plc", ""), ("", ""), ("plc", "one "), ("x", "one")]
        {
            assert!(!users.knows(name, password), "{name} {password}");
        }
        assert!(!Users::new(Vec::new(), true).knows("", ""));
    }
}
